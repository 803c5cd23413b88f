"""Error of every tier against the finite-element scenes, and what a scene costs.

Error of a pin base: length of the difference of its displacements, mm. Of a pin's tip: likewise,
with the pin standing on the turned normal. Of a normal: the angle between both, deg.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.contact import Tips
from tactibench_sim.reference import LAYOUTS, RADIUS_MM, ReferenceScene
from tactibench_sim.table import Tables
from tactibench_sim.tiers import mechanics_for

Array = npt.NDArray[np.float64]
TIERS = ("superpose", "coupled", "auto", "green")
"""In the order of the table and of the colours; ``fem`` is what they are compared with."""
PIN_MM = 2.0
"""Length of the pins whose tips are compared."""
DEPTHS_MM = (3.0, 6.0)
TARGETS_MM = {3.0: {"max": 0.10, "median": 0.03}, 6.0: {"max": 0.25}}
"""What tier ``coupled`` is to reach, per pin base, up to a depth."""
TARGET_ISOLATED_MM = 0.03
"""What tier ``superpose`` is to reach for isolated tips, at most."""
TARGET_US = 100.0
"""Of one core for the field of a dual scene: 20,000 scenes a second on two."""
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
"""Tips that stand alone are counted apart: they are what the tables hold."""
APART = ("all", "isolated")
"""Groups that no other holds."""
QUANTITIES = {"base": "mm", "tip": "mm", "normal": "deg"}
_BATCH = 64
_ROUNDS = 9
_BUDGET_S = 1.2


class Tier(Protocol):
    """What a tier can do; ``loads`` is whatever its own methods take."""

    inner: float

    def loads(self, tips: Tips) -> Any: ...

    def displacement(self, loads: Any, directions: Array) -> tuple[Array, Array]: ...

    def pin_tips(self, loads: Any, directions: Array, length: float) -> Array: ...


@dataclass(frozen=True, eq=False)
class Errors:
    """Of one scene, pin by pin, each (P,): base and tip mm, normal deg."""

    scene: ReferenceScene
    base: Array
    tip: Array
    normal: Array


@dataclass(frozen=True)
class Speed:
    """Of the field of one dual scene, 127 pins, on one thread, us: wall clock and processor."""

    wall: float
    processor: float


@dataclass(frozen=True, eq=False)
class Judged:
    """refused: scenes that the tier does not compute."""

    tier: str
    errors: tuple[Errors, ...]
    refused: tuple[ReferenceScene, ...]
    speed: Speed

    def of(self, group: str, deepest: float) -> list[Errors]:
        """Scenes of a group in which no tip is deeper than ``deepest`` mm."""
        return [e for e in self.errors if GROUPS[group](e.scene) and e.scene.depth <= deepest]

    def worst(self, group: str, deepest: float) -> tuple[Errors, int]:
        """The scene and the pin whose base is farthest off."""
        found = max(self.of(group, deepest), key=lambda e: float(e.base.max()))
        return found, int(found.base.argmax())


def tiers(tables: Tables) -> dict[str, Tier]:
    """Every tier of TIERS by its name."""
    return {tier: mechanics_for(tier, tables) for tier in TIERS}


def judge(name: str, tier: Tier, scenes: Sequence[ReferenceScene]) -> Judged:
    """Compare a tier with every scene and time it. Raises UserError where no scene is left."""
    errors, refused = [], []
    for scene in scenes:
        try:
            errors.append(_errors(tier, scene))
        except UserError:
            refused.append(scene)
    if not errors:
        raise UserError(f"the tier {name} computes none of {len(scenes)} reference scenes.")
    computed = [e.scene for e in errors]
    return Judged(name, tuple(errors), tuple(refused), speed(tier, computed))


def _errors(tier: Tier, scene: ReferenceScene) -> Errors:
    at = scene.directions
    loads = tier.loads(scene.asked)
    u = tier.displacement(loads, at)[0][0]
    normal = tier.inner * at + u - tier.pin_tips(loads, at, 1.0)[0]
    off = np.linalg.norm(u - scene.displacement, axis=1)
    tip = np.linalg.norm(
        (u - PIN_MM * normal) - (scene.displacement - PIN_MM * scene.normals), axis=1
    )
    across = np.linalg.norm(np.cross(normal, scene.normals), axis=1)
    turned = np.degrees(np.arctan2(across, (normal * scene.normals).sum(axis=1)))
    return Errors(scene, off, tip, turned)


def speed(tier: Tier, scenes: Sequence[ReferenceScene]) -> Speed:
    """Median of rounds over the pairs among the scenes (all scenes where there are none)."""
    use = [s for s in scenes if len(s.tips) == 2] or list(scenes)
    most = len(max(use, key=lambda s: len(s.tips)).tips)
    use = [s for s in use if len(s.tips) == most]
    use = (use * (_BATCH // len(use) + 1))[: max(_BATCH, len(use))]
    tips = np.stack([s.tips for s in use])
    asked = Tips(tips[..., :2], tips[..., 2], np.full(len(use), RADIUS_MM))
    at = np.ascontiguousarray(use[0].directions[-LAYOUTS[-1] :])
    tier.displacement(tier.loads(asked), at)  # compiled, and tables made
    wall: list[float] = []
    processor: list[float] = []
    begun = time.perf_counter()
    while len(wall) < 3 or (len(wall) < _ROUNDS and time.perf_counter() - begun < _BUDGET_S):
        start, own = time.perf_counter(), time.thread_time()
        tier.displacement(tier.loads(asked), at)
        processor.append(time.thread_time() - own)
        wall.append(time.perf_counter() - start)
    each = 1e6 / len(use)
    return Speed(each * statistics.median(wall), each * statistics.median(processor))


def pin_name(pin: int) -> str:
    """A pin's number in its own pattern: "pin 17 of 331"."""
    for pins in LAYOUTS:
        if pin < pins:
            return f"pin {pin} of {pins}"
        pin -= pins
    raise IndexError(pin)


def rows(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Everything measured, one number a row: tier, metric, group, value, unit.

    The metric "base_error_max" is the largest over the pins of all scenes in the group, "_median"
    their median. A group without scenes has no row.
    """
    return [row for one in judged for row in (*_errors_of(one), *_costs_of(one))]


def _errors_of(one: Judged) -> list[dict[str, Any]]:
    found = []
    for group, deepest in product(GROUPS, DEPTHS_MM):
        inside, where = one.of(group, deepest), f"{group}, d <= {deepest:g} mm"
        if not inside:
            continue
        found.append(_row(one.tier, "scenes", where, len(inside), "1"))
        for quantity, unit in QUANTITIES.items():
            values = pooled(inside, quantity)
            for kind, value in (("max", values.max()), ("median", np.median(values))):
                found.append(_row(one.tier, f"{quantity}_error_{kind}", where, float(value), unit))
    return found


def _costs_of(one: Judged) -> list[dict[str, Any]]:
    timed = "dual scenes, 127 pins"
    return [
        _row(one.tier, "wall_time", timed, one.speed.wall, "us"),
        _row(one.tier, "processor_time", timed, one.speed.processor, "us"),
        _row(one.tier, "refused", "every scene", len(one.refused), "1"),
    ]


def _row(tier: str, metric: str, group: str, value: float, unit: str) -> dict[str, Any]:
    return {"tier": tier, "metric": metric, "group": group, "value": value, "unit": unit}


def pooled(errors: Sequence[Errors], quantity: str) -> Array:
    """One quantity of all pins of several scenes."""
    return np.concatenate([getattr(e, quantity) for e in errors])


def worst_cases(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """The worst pin base of every tier up to either depth, for JSON."""
    found = []
    for one, group, deepest in product(judged, APART, DEPTHS_MM):
        if not one.of(group, deepest):
            continue
        errors, pin = one.worst(group, deepest)
        found.append(
            {
                "tier": one.tier,
                "group": f"{group}, d <= {deepest:g} mm",
                "scene": errors.scene.name,
                "tips_mm": errors.scene.tips.tolist(),
                "pin": pin_name(pin),
                "value": float(errors.base[pin]),
                "unit": "mm",
            }
        )
    return found
