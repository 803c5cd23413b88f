"""Errors of the tiers against the finite-element scenes, and the time that a scene takes.

There are two views of the same errors. The one by *group* has scenes of R = 3 mm tips up to two
depths, for every tier. The one by *term* of the field that a scene needs has bands of depth,
spacing, radius and shear, for tips of all radii.

The error of a pin base is the length of the difference of its displacements, mm. That of a pin's
tip is the same with the pin standing on the turned normal. That of a normal is the angle between
both normals, deg.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import Mechanics
from tactibench_sim.mechanics.friction import ForceMechanics, FrictionMechanics
from tactibench_sim.reference_frames.scenes import LAYOUTS, RADIUS_MM, ReferenceScene

Array = npt.NDArray[np.float64]
TIERS = ("superpose", "coupled")
"""Tiers in the order of the table and of the colours; ``fem`` is their reference."""
PIN_MM = 2.0
"""Length of the pins whose tips are compared."""
DEPTHS_MM = (3.0, 6.0)
TARGETS_MM = {3.0: {"max": 0.10, "median": 0.03}, 6.0: {"max": 0.25}}
"""Targets of tier ``coupled``, per pin base, up to a depth."""
TARGET_US = 100.0
"""Target for the field of a dual scene on one core: 20,000 scenes a second on two."""
GROUPS: Mapping[str, Callable[[ReferenceScene], bool]] = {
    "all": lambda scene: len(scene.tips) > 1,
    "isolated": lambda scene: len(scene.tips) == 1,
    "pairs": lambda scene: len(scene.tips) == 2,
    "triples": lambda scene: len(scene.tips) == 3,
    "on the apex": lambda scene: len(scene.tips) > 1 and scene.on_apex,
    "off the apex": lambda scene: len(scene.tips) > 1 and not scene.on_apex,
    "equal depths": lambda scene: len(scene.tips) > 1 and scene.equal,
    "unequal depths": lambda scene: len(scene.tips) > 1 and not scene.equal,
}
"""Tips that stand alone are counted apart, because the tables hold their fields."""
APART = ("all", "isolated")
"""Groups that are not part of another group."""
TERMS: Mapping[str, Callable[[ReferenceScene], bool]] = {
    "single": lambda scene: len(scene.tips) == 1 and scene.on_apex and not scene.friction,
    "single, rim": lambda scene: len(scene.tips) == 1 and not scene.on_apex and not scene.friction,
    "single, drag": lambda scene: len(scene.tips) == 1 and scene.friction > 0,
    "pair": lambda scene: len(scene.tips) == 2 and not scene.friction,
    "pair, drag": lambda scene: len(scene.tips) == 2 and scene.friction > 0,
    "three or more": lambda scene: len(scene.tips) > 2,
}
"""The terms of the field that a scene needs; every scene belongs to one."""
DUAL = "pair"
"""The term whose time TARGET_US is for."""


@dataclass(frozen=True)
class Axis:
    """A quantity by which scenes are divided into bands.

    Attributes:
        unit: Unit of the quantity.
        value: Returns the value of a scene; NaN where it has none.
        edges: Upper ends of the bands, rising.
    """

    unit: str
    value: Callable[[ReferenceScene], float]
    edges: tuple[float, ...]

    def bands(self) -> list[tuple[str, float, float]]:
        """Return the name of every band and its ends (low, high]."""
        ends = pairwise((-math.inf, *self.edges))
        return [
            (f"{low:g} to {high:g}" if low > 0 else f"to {high:g}", low, high) for low, high in ends
        ]


AXES: Mapping[str, Axis] = {
    "depth": Axis("mm", lambda scene: scene.depth, (1.0, 2.0, 3.0, 4.5, 6.0)),
    "spacing": Axis("mm", lambda scene: scene.spacing, (3.2, 5.0, 6.5, 8.0, 12.0)),
    "radius": Axis("mm", lambda scene: scene.radius, (1.0, 2.7, 3.0, 5.0, 8.0)),
    "shear": Axis(
        "mm",
        lambda scene: math.hypot(*scene.move) if scene.friction else math.nan,
        (0.25, 0.5, 1.0, 2.0),
    ),
}
QUANTITIES = {"base": "mm", "tip": "mm", "normal": "deg"}
_BATCH = 64
_ROUNDS = 9
_BUDGET_S = 0.6


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors in one scene, pin by pin.

    Attributes:
        scene: The scene.
        base: (P,) errors of the pin bases, mm.
        tip: (P,) errors of the pin tips, mm.
        normal: (P,) errors of the normals, deg.
    """

    scene: ReferenceScene
    base: Array
    tip: Array
    normal: Array


@dataclass(frozen=True)
class Speed:
    """Time of the field of one scene with 127 pins on one thread.

    Attributes:
        wall: Time by the wall clock, us.
        processor: Time of the processor, us.
    """

    wall: float
    processor: float


@dataclass(frozen=True, eq=False)
class TierErrors:
    """Errors and speed of a tier.

    Attributes:
        name: Name of the tier.
        errors: Errors in each scene that the tier computes.
        refused: Scenes that the tier does not compute.
        costs: Term -> time of its scenes of R = 3 mm tips.
    """

    name: str
    errors: tuple[Errors, ...]
    refused: tuple[ReferenceScene, ...]
    costs: Mapping[str, Speed]

    @property
    def speed(self) -> Speed:
        """Time of a dual scene or, where there is none, of the first term."""
        return self.costs.get(DUAL) or next(iter(self.costs.values()))

    def errors_in(self, group: str, deepest: float) -> list[Errors]:
        """Return the errors in scenes of a group in which no tip is deeper than ``deepest`` mm."""
        return [
            e
            for e in self.errors
            if GROUPS[group](e.scene) and e.scene.depth <= deepest and _nominal(e.scene)
        ]

    def errors_of(self, term: str, axis: str, low: float, high: float) -> list[Errors]:
        """Return the errors in scenes of a term whose value on an axis is in (low, high]."""
        value = AXES[axis].value
        return [e for e in self.errors if TERMS[term](e.scene) and low < value(e.scene) <= high]

    def worst(self, group: str, deepest: float) -> tuple[Errors, int]:
        """Return the errors of the scene, and the pin there, whose base is farthest off.

        Args:
            group: Name of a group in GROUPS.
            deepest: Greatest depth of a tip, mm.
        """
        worst = max(self.errors_in(group, deepest), key=lambda e: float(e.base.max()))
        return worst, int(worst.base.argmax())


def _nominal(scene: ReferenceScene) -> bool:
    return scene.radius == RADIUS_MM and not scene.friction


def judge(name: str, tier: ForceMechanics, scenes: Sequence[ReferenceScene]) -> TierErrors:
    """Compare a tier with every scene and time it.

    Args:
        name: Name of the tier.
        tier: The tier, without friction.
        scenes: The scenes, with friction or without.

    Raises:
        UserError: The tier computes none of the scenes.
    """
    errors, refused = [], []
    for scene in scenes:
        try:
            errors.append(_errors(tier, scene))
        except UserError:
            refused.append(scene)
    if not errors:
        raise UserError(f"the tier {name} computes none of {len(scenes)} reference scenes.")
    computed = [e.scene for e in errors if e.scene.radius == RADIUS_MM]
    of_terms = {term: [s for s in computed if holds(s)] for term, holds in TERMS.items()}
    costs = {term: speed(tier, some) for term, some in of_terms.items() if some}
    return TierErrors(name, tuple(errors), tuple(refused), costs)


def _with_friction(tier: ForceMechanics, scene: ReferenceScene) -> Mechanics:
    return FrictionMechanics(tier, scene.friction) if scene.friction else tier


def _errors(frictionless: ForceMechanics, scene: ReferenceScene) -> Errors:
    tier = _with_friction(frictionless, scene)
    at = scene.directions
    loads = tier.loads(scene.as_tips)
    u = tier.displacement(loads, at)[0][0]
    normal = tier.inner * at + u - tier.pin_tips(loads, at, 1.0)[0]
    off = np.linalg.norm(u - scene.displacement, axis=1)
    tip = np.linalg.norm(
        (u - PIN_MM * normal) - (scene.displacement - PIN_MM * scene.normals), axis=1
    )
    across = np.linalg.norm(np.cross(normal, scene.normals), axis=1)
    turned = np.degrees(np.arctan2(across, (normal * scene.normals).sum(axis=1)))
    return Errors(scene, off, tip, turned)


def speed(frictionless: ForceMechanics, scenes: Sequence[ReferenceScene]) -> Speed:
    """Return the median time of several rounds.

    Args:
        frictionless: The tier.
        scenes: Scenes with the same number of tips of R = 3 mm; the friction of the first one is
            taken for all.
    """
    tier = _with_friction(frictionless, scenes[0])
    use = (list(scenes) * (_BATCH // len(scenes) + 1))[: max(_BATCH, len(scenes))]
    tips = np.stack([s.tips for s in use])
    move = None
    if scenes[0].friction:
        move = np.stack([np.tile(s.move, (len(s.tips), 1)) for s in use])
    batch = Tips(tips[..., :2], tips[..., 2], np.full(len(use), RADIUS_MM), move)
    at = np.ascontiguousarray(use[0].directions[-LAYOUTS[-1] :])
    tier.displacement(tier.loads(batch), at)  # compiles the loops and makes tables
    wall: list[float] = []
    processor: list[float] = []
    begun = time.perf_counter()
    while len(wall) < 3 or (len(wall) < _ROUNDS and time.perf_counter() - begun < _BUDGET_S):
        start, processor_start = time.perf_counter(), time.thread_time()
        tier.displacement(tier.loads(batch), at)
        processor.append(time.thread_time() - processor_start)
        wall.append(time.perf_counter() - start)
    each = 1e6 / len(use)
    return Speed(each * statistics.median(wall), each * statistics.median(processor))


def pin_name(pin: int) -> str:
    """Return a pin's number in its own pattern, such as "pin 17 of 331".

    Args:
        pin: Number of the pin among those of both patterns.

    Raises:
        IndexError: There are not so many pins.
    """
    for pins in LAYOUTS:
        if pin < pins:
            return f"pin {pin} of {pins}"
        pin -= pins
    raise IndexError(pin)


def rows(tiers: Sequence[TierErrors]) -> list[dict[str, Any]]:
    """Return every number as a row of tier, metric, group, value, unit.

    The metric "base_error_max" is the largest over the pins of all scenes in the group, "_median"
    their median. A group without scenes has no row.
    """
    return [
        row for tier in tiers for row in (*_error_rows(tier), *_term_rows(tier), *_cost_rows(tier))
    ]


def _error_rows(tier: TierErrors) -> list[dict[str, Any]]:
    rows = []
    for group, deepest in product(GROUPS, DEPTHS_MM):
        inside, where = tier.errors_in(group, deepest), f"{group}, d <= {deepest:g} mm"
        if not inside:
            continue
        rows.append(_row(tier.name, "scenes", where, len(inside), "1"))
        for quantity, unit in QUANTITIES.items():
            values = pooled(inside, quantity)
            for kind, value in (("max", values.max()), ("median", np.median(values))):
                rows.append(_row(tier.name, f"{quantity}_error_{kind}", where, float(value), unit))
    return rows


def _term_rows(tier: TierErrors) -> list[dict[str, Any]]:
    rows = []
    for (axis, facts), term in product(AXES.items(), TERMS):
        for band, low, high in facts.bands():
            inside = tier.errors_of(term, axis, low, high)
            if not inside:
                continue
            where, values = f"{term}, {axis} {band} {facts.unit}", pooled(inside, "base")
            rows.append(_row(tier.name, "scenes", where, len(inside), "1"))
            rows.append(_row(tier.name, "base_error_max", where, float(values.max()), "mm"))
            median = float(np.median(values))
            rows.append(_row(tier.name, "base_error_median", where, median, "mm"))
    return rows


def _cost_rows(tier: TierErrors) -> list[dict[str, Any]]:
    rows = []
    for term, cost in tier.costs.items():
        timed = f"{term}, 127 pins"
        rows.append(_row(tier.name, "wall_time", timed, cost.wall, "us"))
        rows.append(_row(tier.name, "processor_time", timed, cost.processor, "us"))
    return [*rows, _row(tier.name, "refused", "every scene", len(tier.refused), "1")]


def _row(tier: str, metric: str, group: str, value: float, unit: str) -> dict[str, Any]:
    return {"tier": tier, "metric": metric, "group": group, "value": value, "unit": unit}


def pooled(errors: Sequence[Errors], quantity: str) -> Array:
    """Return one of QUANTITIES of all pins of several scenes."""
    return np.concatenate([getattr(e, quantity) for e in errors])


def worst_cases(tiers: Sequence[TierErrors]) -> list[dict[str, Any]]:
    """Return the worst pin base of every tier up to each depth, for JSON."""
    rows = []
    for tier, group, deepest in product(tiers, APART, DEPTHS_MM):
        if not tier.errors_in(group, deepest):
            continue
        errors, pin = tier.worst(group, deepest)
        rows.append(
            {
                "tier": tier.name,
                "group": f"{group}, d <= {deepest:g} mm",
                "scene": errors.scene.name,
                "tips_mm": errors.scene.tips.tolist(),
                "pin": pin_name(pin),
                "value": float(errors.base[pin]),
                "unit": "mm",
            }
        )
    return rows
