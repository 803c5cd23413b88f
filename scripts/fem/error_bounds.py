"""Measured error bounds of the simulated dome, against finite-element scenes.

    PYTHONPATH=.:plugins python scripts/fem/error_bounds.py error_bounds.json

It takes a minute. The file belongs in plugins/tactibench_sim/data; ``tactibench_sim.error_bounds``
reads it and explains the bounds. They are those of the tables that ship.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file
from scipy.optimize import linprog

from tactibench.lab import atomic
from tactibench_sim import (
    BEYOND,
    FRICTION_TERMS,
    LARGEST_MM,
    LEVER_MM,
    RADIUS_MM,
    RATIO_FACTOR,
    SKIN_FACTOR,
    SMALLEST_MM,
    Bounds,
    Envelope,
    FrictionMechanics,
    ReferenceScene,
    TableFile,
    TableMechanics,
    Tables,
    Tips,
    angle_between,
    envelope_terms,
    press_of,
    read_file,
    reference_scenes,
    shipped_dome,
    tables_between,
    turned_normals,
)

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
DATA = Path(__file__).resolve().parents[2] / "tests" / "sim" / "data"
MARGIN = 0.05
"""The factor is rounded up to a multiple of this: a dozen families of runs do not determine it more
finely."""
LEAST = 1.1
"""Least factor: the terms were chosen with all runs in sight, so that the test by leaving runs out
makes them look better than they are."""
SLACK_MM, SLACK_RAD = 0.1, math.radians(0.5)
"""Distance by which a scene may lie outside of the measured range: about a tenth of the steps
between the reference scenes."""
TYPICAL = 0.5
"""Share of its bound by which a frictionless scene is off, in the mean. Friction is taken to add
what a scene is off beyond that."""
FEW_DOMES = 2.0
"""Factor on what the scenes of other domes are off beyond the bounds: they are of a few domes, at
corners of the range, and of the nominal tip."""
_STEP = 1e-6  # coefficients are rounded up to a multiple of it; terms reach 10^3
_CLOSE = 1e-6


@dataclass(frozen=True, eq=False)
class Measured:
    """S reference scenes and their errors.

    Attributes:
        families: Names of the presses that the scenes are moments of.
        tips: Their tips.
        errors: (S, 2) largest error of a pin base, and of the tip of a pin of LEVER_MM, mm.
    """

    families: tuple[str, ...]
    tips: Tips
    errors: Array

    def take(self, rows: Flags) -> Measured:
        """Return some of the scenes."""
        index = np.flatnonzero(rows)
        families = tuple(self.families[row] for row in index)
        return Measured(families, self.tips.take(index), self.errors[index])


def measure(scenes: Sequence[ReferenceScene], tables: Tables | None = None) -> Measured:
    """Return the errors of tables in reference scenes.

    Where a scene has no normals, the error of tips is nan.

    Args:
        scenes: S scenes.
        tables: Tables of their dome; None: those of the nominal one, for tips of all radii.
    """
    plain = TableMechanics(tables or shipped_dome(), "coupled", other_tips=tables is None)
    errors = []
    for scene in scenes:
        rub = FrictionMechanics(plain, scene.friction) if scene.friction else plain
        u, q = rub.displacement(rub.loads(scene.as_tips), scene.directions)  # type: ignore[arg-type]
        base = u[0] - scene.displacement
        turn = turned_normals(scene.directions, q[0]) - scene.normals
        errors.append([_largest(base), _largest(base - LEVER_MM * turn)])
    return Measured(tuple(map(press_of, scenes)), joined(scenes), np.array(errors))


def _largest(off: Array) -> float:
    return float(np.linalg.norm(off, axis=1).max())


def joined(scenes: Sequence[ReferenceScene]) -> Tips:
    """Return the tips of scenes as one batch."""
    most = max(len(scene.tips) for scene in scenes)
    xy, depth = np.zeros((len(scenes), most, 2)), np.full((len(scenes), most), -np.inf)
    for row, scene in enumerate(scenes):
        xy[row, : len(scene.tips)] = scene.tips[:, :2]
        depth[row, : len(scene.tips)] = scene.tips[:, 2]
    radius, friction = (np.array([getattr(s, k) for s in scenes]) for k in ("radius", "friction"))
    return Tips(xy, depth, radius, friction=friction)


def measured(scenes: Sequence[ReferenceScene], instances: TableFile) -> Bounds:
    """Return the bounds of the tips of the scenes.

    Args:
        scenes: Scenes of the nominal dome.
        instances: Scenes of other domes, with their ``domes``: stiffness ratio and skin, mm.
    """
    every = measure(scenes)
    radius = every.tips.radius
    rough = np.asarray(every.tips.friction, dtype=np.float64) > 0
    # Few runs of other tips have normals; in the others tips are taken to be off by as many times
    # what bases are.
    base, tip = every.errors[radius != RADIUS_MM].T
    unknown = np.isnan(every.errors[:, 1])
    every.errors[unknown, 1] = np.nanmax(tip / base) * every.errors[unknown, 0]
    envelopes = []
    for low, high in (
        (RADIUS_MM, RADIUS_MM),
        (SMALLEST_MM, RADIUS_MM),
        (RADIUS_MM, LARGEST_MM),
    ):
        nominal = radius == RADIUS_MM if low == high else radius != RADIUS_MM
        rows = (radius >= low) & (radius <= high) & nominal
        for fewest, group in by_contacts(every.take(rows & ~rough)):
            envelopes.append(envelope(group, low, high, fewest))
    bounds = Bounds(tuple(with_friction(envelopes, every.take(rough))), np.zeros(2))
    return replace(bounds, instance=beyond_nominal(bounds, instances))


def beyond_nominal(bounds: Bounds, instances: TableFile) -> Array:
    """Return (2,) mm per mm of depth that scenes of other domes are off beyond the bounds."""
    nominal = shipped_dome()
    dome, most = nominal.parameters["dome"], np.zeros(2)
    for scene in reference_scenes(instances):
        ratio, skin = instances.parameters["domes"][scene.name]
        x = math.log(ratio / dome["stiffness_ratio"], RATIO_FACTOR)
        found = measure([scene], tables_between(nominal, x, math.log(skin, SKIN_FACTOR)))
        known = np.array([bounds.bound(found.tips, length)[0] for length in (0.0, LEVER_MM)])
        most = np.maximum(most, (found.errors[0] - known) / found.tips.directions()[1].max())
    return FEW_DOMES * most


def by_contacts(scenes: Measured) -> tuple[tuple[int, Measured], ...]:
    """Return the scenes of one contact and those of several, each with its fewest contacts."""
    several = (scenes.tips.directions()[1] > 0).sum(axis=1) > 1
    return (1, scenes.take(~several)), (2, scenes.take(several))


def envelope(scenes: Measured, smallest: float, largest: float, fewest: int) -> Envelope:
    """Return the envelope of scenes of ``fewest`` and more tips of radii in a range, mm."""
    n, delta = scenes.tips.directions()
    touching = delta > 0
    pairs = [
        angle_between(n[:, i], n[:, j])[touching[:, i] & touching[:, j]]
        for i, j in combinations(range(delta.shape[1]), 2)
    ]
    angle = np.concatenate([np.empty(0), *pairs])
    base, tip = (fitted(scenes, column) for column in range(scenes.errors.shape[1]))
    return Envelope(
        smallest,
        largest,
        fewest,
        base,
        tip,
        deepest=float(delta.max()) + SLACK_MM,
        nearest=float(angle.min() if len(angle) else 0.0) - SLACK_RAD,
        farthest=float(angle.max(initial=0.0)) + SLACK_RAD,
        lowest=float(np.arccos(n[touching][:, 2].min())) + SLACK_RAD,
        most=int(touching.sum(axis=1).max()),
    )


def fitted(scenes: Measured, column: int) -> Array:
    """Return the (T,) coefficients of an envelope of frictionless scenes with their factor.

    Args:
        scenes: The scenes.
        column: 0: of bases; 1: of tips.
    """
    terms, errors = envelope_terms(scenes.tips), scenes.errors[:, column]
    smooth = Fit(terms[:, : FRICTION_TERMS.start], errors, errors)
    out = np.zeros(terms.shape[1])
    out[: FRICTION_TERMS.start] = smooth.factor(scenes.families) * smooth.coefficients()
    return out


def with_friction(envelopes: Sequence[Envelope], scenes: Measured) -> Sequence[Envelope]:
    """Return envelopes with what friction adds: BEYOND times what is measured for other radii.

    Args:
        envelopes: Envelopes of frictionless scenes.
        scenes: Scenes of the nominal tip with friction.
    """
    smooth, parts = Bounds(tuple(envelopes), np.zeros(2)), {}
    for fewest, group in by_contacts(scenes):
        for column, (name, length) in enumerate((("base", 0.0), ("tip", LEVER_MM))):
            errors = group.errors[:, column]
            off = (errors - TYPICAL * smooth.bound(group.tips, length)).clip(0.0)
            rubbing = Fit(envelope_terms(group.tips)[:, FRICTION_TERMS], off, errors)
            parts[fewest, name] = rubbing.factor(group.families) * rubbing.coefficients()
    out = []
    for envelope in envelopes:
        share = 1.0 if envelope.smallest == envelope.largest else BEYOND
        added = {name: getattr(envelope, name).copy() for name in ("base", "tip")}
        for name, coefficients in added.items():
            coefficients[FRICTION_TERMS] = share * parts[envelope.fewest, name]
        out.append(replace(envelope, **added))
    return out


@dataclass(frozen=True, eq=False)
class Fit:
    """Terms of S scenes that are to hold what the scenes are off.

    Attributes:
        terms: (S, N) terms.
        off: (S,) what they must hold, mm.
        errors: (S,) errors of the scenes, mm; the mean of the bounds over them is to be the least.
    """

    terms: Array
    off: Array
    errors: Array

    def coefficients(self, but: Flags | None = None) -> Array:
        """Return the (N,) coefficients >= 0 that hold all scenes: a linear program.

        Args:
            but: (S,) scenes that do not count.
        """
        rows = slice(None) if but is None else ~but
        terms = self.terms[rows]
        each = (terms / self.errors[rows, None]).mean(axis=0)
        solution = linprog(each, A_ub=-terms, b_ub=-self.off[rows], bounds=(0, None))
        if not solution.success:
            raise RuntimeError(f"no envelope was found: {solution.message}")
        out: Array = solution.x
        return out

    def excess(self, left: Flags) -> float:
        """Return the largest of what some scenes are off over the envelope of all others."""
        bound = self.terms[left] @ self.coefficients(left)
        off = self.off[left]
        return float(np.divide(off, bound, out=np.zeros_like(off), where=off > 0).max())

    def factor(self, families: Sequence[str]) -> float:
        """Return the factor with which the envelope holds every family that is left out."""
        names = np.array(families)
        worst = max(self.excess(names == name) for name in set(families))
        return max(LEAST, MARGIN * math.ceil(worst / MARGIN - _CLOSE))


def write(path: Path, bounds: Bounds) -> str:
    """Write bounds as JSON and return the sha256 of the file. Coefficients are rounded up."""
    content = {
        "envelopes": [
            {name: _rounded(value) for name, value in asdict(envelope).items()}
            for envelope in bounds.envelopes
        ],
        "instance": _rounded(bounds.instance),
    }
    text = json.dumps(content, allow_nan=False)
    for name in ("tip", "deepest"):  # lines of a length that can be read
        text = text.replace(f', "{name}"', f',\n"{name}"')
    text = text.replace("}, {", "},\n{") + "\n"
    with atomic(path) as out:
        out.write(text.encode())
    return hashlib.sha256(text.encode()).hexdigest()


def _rounded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [round(each, 6) for each in (np.ceil(value / _STEP - _CLOSE) * _STEP).tolist()]
    return round(value, 4)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Measure the error bounds of the simulated dome.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    spacings, others, instances = (
        read_file(DATA / f"{name}.npz") for name in ("spacings", "other_tips", "instances")
    )
    scenes = (*reference_scenes(), *reference_scenes(spacings), *reference_scenes(others))
    write_file(given.out, lambda: write(given.out, measured(scenes, instances)))


if __name__ == "__main__":
    main()
