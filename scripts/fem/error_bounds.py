"""Measured error bounds of tier ``coupled``, against the finite-element scenes that ship.

    PYTHONPATH=.:plugins python scripts/fem/error_bounds.py error_bounds.json

It takes seconds. The file belongs in plugins/tactibench_sim/data; ``tactibench_sim.error_bounds``
reads it and explains the bounds. They are measured for one table file and unknown for any other.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file
from scipy.optimize import linprog

from tactibench.lab import atomic
from tactibench_sim import (
    LARGEST_MM,
    RADIUS_MM,
    SMALLEST_MM,
    Bounds,
    Envelope,
    OtherTips,
    ReferenceScene,
    TableMechanics,
    Tables,
    angle_between,
    envelope_terms,
    read_file,
    reference_scenes,
    shipped_dome,
    shipped_file,
)

Array = npt.NDArray[np.float64]
OTHER_TIPS = Path(__file__).resolve().parents[2] / "tests" / "sim" / "data" / "other_tips.npz"
DEPTH_MM = (1.0, 2.0, 3.0, 4.5, 6.0, 6.5)
POLAR_DEG = (20.0, 40.0, 55.0)
OTHERS_MM = ((SMALLEST_MM, RADIUS_MM), (RADIUS_MM, LARGEST_MM))
"""Radii of sharper and of blunter tips: errors of blunt ones hardly grow with depth."""
MARGIN = 0.05
"""The factor is rounded up to a multiple of this: half a dozen families of runs do not determine it
more finely."""
LEAST = 1.1
"""Least factor: the terms were chosen with all runs in sight, so that the test by leaving runs out
makes them look better than they are."""
SLACK_MM, SLACK_DEG = 0.1, 0.5
"""Distance by which a scene may lie outside of the measured range: about a tenth of the steps
between the reference scenes."""
FEWEST_FAMILIES = 3
"""Least number of families: with fewer, too few are left to find the coefficients when one family
is left out."""
_STEP_MM = 1e-4  # bounds are rounded up to a multiple of it when they are written
_STEP_COEFFICIENT = 1e-6  # likewise coefficients, which are multiplied by up to 10^3 mm^3
_CLOSE = 1e-6  # distance by which scenes may be off the node that they were made for

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Measured:
    """A reference scene and its error.

    Attributes:
        name: Name of the run, which is its family.
        n: (K, 3) directions of the contacts.
        delta: (K,) penetrations, mm.
        error: Largest error of a pin base, mm.
        radius: Radius of the tips, mm.
    """

    name: str
    n: Array
    delta: Array
    error: float
    radius: float = RADIUS_MM

    @property
    def kin(self) -> tuple[float, str]:
        """Spacing or radius that the family shares with others, as a number and as text."""
        if self.radius != RADIUS_MM:
            return self.radius, f"of R = {self.radius:g} mm"
        spacing = re.match(r"[pt]([\d.]+)", self.name)  # "8" of p8_off10
        assert spacing is not None  # noqa: S101 - pairs and triples are named by their spacing
        return float(spacing[1]), f"{spacing[1]} mm apart"


def measure(tables: Tables, scenes: Sequence[ReferenceScene]) -> list[Measured]:
    """Return the errors of tier ``coupled`` in reference scenes, computed with the given tables."""
    coupled = TableMechanics(tables, "coupled", other_tips=True)
    out = []
    for scene in scenes:
        loads = coupled.loads(scene.as_tips)
        off = coupled.displacement(loads, scene.directions)[0][0] - scene.displacement
        error = float(np.linalg.norm(off, axis=1).max())
        (n,), (delta,) = scene.as_tips.directions()
        out.append(Measured(scene.name, n, delta, error, scene.radius))
    return out


def measured(tables: Tables, scenes: Sequence[ReferenceScene]) -> Bounds:
    """Return the bounds with the given tables, for the tips of the scenes."""
    every = measure(tables, scenes)
    errors = [scene for scene in every if scene.radius == RADIUS_MM]
    alone = [scene for scene in errors if len(scene.delta) == 1]
    rings = np.radians(POLAR_DEG)
    return Bounds(
        depth=np.array(DEPTH_MM),
        polar=rings,
        single=_singles(rings, alone),
        pair=envelope([scene for scene in errors if len(scene.delta) == 2]),
        many=envelope([scene for scene in errors if len(scene.delta) > 2]),
        others=tuple(
            OtherTips(low, high, *(envelope(some) for some in other_tips(every, low, high)))
            for low, high in OTHERS_MM
        ),
    )


def other_tips(
    errors: Sequence[Measured], low: float, high: float
) -> tuple[list[Measured], list[Measured]]:
    """Return the single contacts and the pairs of tips of radii other than RADIUS_MM.

    Args:
        errors: Reference scenes of all tips.
        low: Smallest radius, mm.
        high: Largest radius, mm.
    """
    in_range = [
        scene for scene in errors if low <= scene.radius <= high and scene.radius != RADIUS_MM
    ]
    single, pair = ([scene for scene in in_range if len(scene.delta) == count] for count in (1, 2))
    return single, pair


def envelope(scenes: Sequence[Measured]) -> Envelope:
    """Return the envelope of scenes that have equally many contacts.

    An envelope of fewer than FEWEST_FAMILIES families has an empty range.
    """
    if len({scene.name for scene in scenes}) < FEWEST_FAMILIES:
        return Envelope(np.zeros(4), 1.0, 0.0, 0.0, 0.0, 0.0)
    n, delta = np.stack([scene.n for scene in scenes]), np.stack([scene.delta for scene in scenes])
    pairs = combinations(range(delta.shape[1]), 2)
    angle = np.array([angle_between(n[:, i], n[:, j]) for i, j in pairs] or [np.zeros(1)])
    slack = math.radians(SLACK_DEG)
    return Envelope(
        _coefficients(scenes),
        max(LEAST, MARGIN * math.ceil(max(leave_out(scenes).values()) / MARGIN - _CLOSE)),
        float(delta.max()) + SLACK_MM,
        float(angle.min()) - slack,
        float(angle.max()) + slack,
        float(np.arccos(n[..., 2].min())) + slack,
    )


def leave_out(scenes: Sequence[Measured]) -> dict[str, float]:
    """Return name of a group -> its largest error over the envelope of all others.

    Every family is left out alone. The families of one spacing or one radius are left out together
    where at least FEWEST_FAMILIES others remain: without the triples 8 mm apart no deep triple off
    the apex would be left.
    """
    groups: dict[str, list[str]] = {scene.name: [scene.name] for scene in scenes}
    families = len(groups)
    for _, kin in sorted({scene.kin for scene in scenes}):
        names = sorted({scene.name for scene in scenes if scene.kin[1] == kin})
        if len(names) > 1 and families - len(names) >= FEWEST_FAMILIES:
            groups[f"all {kin}"] = names
    return {group: _without(scenes, names) for group, names in groups.items()}


def _without(scenes: Sequence[Measured], names: Sequence[str]) -> float:
    """Return the largest error of the named families over the envelope of the others."""
    coefficients = _coefficients([scene for scene in scenes if scene.name not in names])
    left = [scene for scene in scenes if scene.name in names]
    return float((_errors(left) / (_terms(left) @ coefficients)).max())


def _coefficients(scenes: Sequence[Measured]) -> Array:
    """Return the coefficients >= 0 of least mean bound that hold every scene: a linear program."""
    terms, errors = _terms(scenes), _errors(scenes)
    solution = linprog(terms.mean(axis=0), A_ub=-terms, b_ub=-errors, bounds=(0, None))
    if not solution.success:
        raise RuntimeError(f"no envelope was found: {solution.message}")
    coefficients: Array = solution.x
    return coefficients


def _terms(scenes: Sequence[Measured]) -> Array:
    n, delta = np.stack([scene.n for scene in scenes]), np.stack([scene.delta for scene in scenes])
    return envelope_terms(n, np.maximum(delta, 0.0))


def _errors(scenes: Sequence[Measured]) -> Array:
    return np.array([scene.error for scene in scenes])


def largest(nodes: Sequence[float], deepest: Array, errors: Array) -> Array:
    """Return the (D,) largest error of all scenes up to each depth node, mm; it never falls.

    Args:
        nodes: (D,) depth nodes, mm.
        deepest: (S,) greatest penetration of each scene, mm.
        errors: (S,) error of each scene, mm.
    """
    return np.array([errors[deepest <= node + _CLOSE].max(initial=0.0) for node in nodes])


def reached(nodes: Sequence[float], deepest: Array) -> Flags:
    """Return (D,) flags: whether a scene reaches a node, or is nearer to it than to the one before.

    Args:
        nodes: (D,) depth nodes, mm.
        deepest: (S,) greatest penetration of each scene, mm.
    """
    middle = np.array([(a + b) / 2 for a, b in pairwise([0.0, *nodes])])
    return np.asarray(middle <= deepest.max(initial=0.0))


def write(path: Path, tables: Tables, bounds: Bounds) -> str:
    """Write bounds as JSON and return the sha256 of the file.

    Bounds are rounded up; infinity is written as null.
    """
    content: dict[str, Any] = {"tables": tables.digest, "tips": shipped_file("tips.npz").digest}
    content |= {f.name: _rounded(getattr(bounds, f.name)) for f in fields(Bounds)}
    text = json.dumps(content, allow_nan=False).replace('], "', '],\n"') + "\n"
    with atomic(path) as out:
        out.write(text.encode())
    return hashlib.sha256(text.encode()).hexdigest()


def _rounded(values: Any) -> Any:
    if isinstance(values, tuple):
        return [_rounded(value) for value in values]
    if isinstance(values, OtherTips):
        envelopes = {name: _rounded(getattr(values, name)) for name in ("single", "pair")}
        return {"smallest": values.smallest, "largest": values.largest, **envelopes}
    if isinstance(values, Envelope):
        up = np.ceil(values.coefficients / _STEP_COEFFICIENT) * _STEP_COEFFICIENT
        rest = {f.name: round(getattr(values, f.name), 4) for f in fields(Envelope)[1:]}
        return {"coefficients": [round(value, 6) for value in up.tolist()], **rest}
    if values.ndim:
        return [_rounded(value) for value in values]
    if math.isinf(values):
        return None
    return round(math.ceil(float(values) / _STEP_MM - _CLOSE) * _STEP_MM, 4)


def _singles(rings: Array, alone: Sequence[Measured]) -> Array:
    """Return the (B, D) largest errors of single contacts up to a polar angle and a depth, mm.

    The error is inf where no scene between the polar angle and the one before reaches the depth.
    """
    polar = np.array([math.acos(min(1.0, scene.n[0, 2])) for scene in alone])
    deepest, errors = np.array([scene.delta[0] for scene in alone]), _errors(alone)
    rows = []
    for above, below in pairwise([-1.0, *rings]):
        inside = polar <= below + _CLOSE
        held = reached(DEPTH_MM, deepest[inside & (polar > above + _CLOSE)])
        rows.append(np.where(held, largest(DEPTH_MM, deepest[inside], errors[inside]), np.inf))
    return np.stack(rows)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Measure the error bounds of tier coupled.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    tables, scenes = shipped_dome(), (*reference_scenes(), *reference_scenes(read_file(OTHER_TIPS)))
    write_file(given.out, lambda: write(given.out, tables, measured(tables, scenes)))


if __name__ == "__main__":
    main()
