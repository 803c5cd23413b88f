"""Measured error bounds of the tiers, against the finite-element scenes that ship.

    PYTHONPATH=.:plugins python scripts/fem/error_bounds.py error_bounds.json

Seconds. The file stands in plugins/tactibench_sim; ``tactibench_sim.error_bounds`` reads it and
says what the bounds are. With --leave-out nothing is written: a table shows, for every family of
runs and every spacing that is left out, its largest error over the bound from all others.

The error of ``superpose`` is, by the triangle inequality, no larger than that of ``coupled`` and
the difference of the two tiers together. Bounds are measured for one table file and unknown for any
other.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import output_file, write_file
from modes import Chart
from scipy.optimize import linprog

from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.error_bounds import (
    RADIUS_MM,
    Bounds,
    Envelope,
    OtherTips,
    angle_between,
    envelope_terms,
)
from tactibench_sim.mechanics import tables, tip_tables
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.kernels import Array
from tactibench_sim.mechanics.tables import Tables
from tactibench_sim.mechanics.tip_tables import LARGEST_MM, SMALLEST_MM
from tactibench_sim.mechanics.tips import TipMechanics
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.reference_frames.scenes import ReferenceScene

DEPTH_MM = (1.0, 2.0, 3.0, 4.5, 6.0, 6.5)
POLAR_DEG = (20.0, 40.0, 55.0)
ANGLE_DEG = (14.0, 18.5, 24.0, 31.0, 40.0)
OTHERS_MM = ((SMALLEST_MM, RADIUS_MM), (RADIUS_MM, LARGEST_MM))
"""Radii of sharper and of blunter tips: errors of blunt ones hardly grow with depth."""
ADDED_DEPTH_MM = (0.0, 0.75, 1.75, 3.0, 4.5, 6.0)
CHART = Chart(start=-75.0, reach=75.0, across=75.0, step=2.5)
"""Where the two tiers are compared, around the middle of a pair; it is symmetric."""
MARGIN = 0.05
"""The factor is rounded up to a multiple of this: half a dozen families of runs do not say it more
finely."""
LEAST = 1.1
"""And it is never less: the terms were chosen with all runs in sight, so that leaving some out
flatters them."""
SLACK_MM, SLACK_DEG = 0.1, 0.5
"""By how much a scene may lie outside of the measured range: about a tenth of the steps between
the reference scenes."""
FEWEST_FAMILIES = 3
"""With fewer, too little is left to find the coefficients from when one is left out."""
_STEP_MM = 1e-4  # bounds are written rounded up to it
_STEP_COEFFICIENT = 1e-6  # and coefficients, which stand before up to 10^3 mm^3
_CLOSE = 1e-6  # by which scenes may be off the node they were made for

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Measured:
    """A reference scene and its error.

    n: (K, 3). delta: (K,) mm. error: largest of a pin base, mm. radius: of the tips, mm.
    """

    name: str
    n: Array
    delta: Array
    error: float
    radius: float = RADIUS_MM

    @property
    def kin(self) -> tuple[float, str]:
        """What it shares with other families, as number and text: its spacing, or its radius."""
        if self.radius != RADIUS_MM:
            return self.radius, f"of R = {self.radius:g} mm"
        found = re.match(r"[pt]([\d.]+)", self.name)  # "8" of p8_off10
        assert found is not None  # noqa: S101 - pairs and triples are named by their spacing
        return float(found[1]), f"{found[1]} mm apart"


def measure(tables: Tables, scenes: Sequence[ReferenceScene]) -> list[Measured]:
    """Return the errors of tier ``coupled`` with those tables."""
    coupled = TipMechanics(TableMechanics(tables, "coupled"))
    out = []
    for scene in scenes:
        loads = coupled.loads(scene.as_tips)
        off = coupled.displacement(loads, scene.directions)[0][0] - scene.displacement
        error = float(np.linalg.norm(off, axis=1).max())
        (n,), (delta,) = scene.as_tips.directions()
        out.append(Measured(scene.name, n, delta, error, scene.radius))
    return out


def measured(tables: Tables, scenes: Sequence[ReferenceScene]) -> Bounds:
    """Return the bounds of the tiers with those tables, for the tips of the scenes."""
    every = measure(tables, scenes)
    errors = [one for one in every if one.radius == RADIUS_MM]
    coupled, superposed = TableMechanics(tables, "coupled"), TableMechanics(tables, "superpose")
    alone = [one for one in errors if len(one.delta) == 1]
    rings = np.radians(POLAR_DEG)
    return Bounds(
        depth=np.array(DEPTH_MM),
        polar=rings,
        single=_singles(rings, alone),
        pair=envelope([one for one in errors if len(one.delta) == 2]),
        many=envelope([one for one in errors if len(one.delta) > 2]),
        angle=np.radians(ANGLE_DEG),
        added_depth=np.array(ADDED_DEPTH_MM),
        added=np.stack([_added(coupled, superposed, math.radians(deg)) for deg in ANGLE_DEG]),
        others=tuple(
            OtherTips(low, high, *(envelope(some) for some in other_tips(every, low, high)))
            for low, high in OTHERS_MM
        ),
    )


def other_tips(
    errors: Sequence[Measured], low: float, high: float
) -> tuple[list[Measured], list[Measured]]:
    """Return the single contacts and the pairs of tips of other radii in a range."""
    here = [one for one in errors if low <= one.radius <= high and one.radius != RADIUS_MM]
    single, pair = ([one for one in here if len(one.delta) == count] for count in (1, 2))
    return single, pair


def envelope(scenes: Sequence[Measured]) -> Envelope:
    """Return the envelope of scenes with equally many contacts; of too few one of no range."""
    if len({one.name for one in scenes}) < FEWEST_FAMILIES:
        return Envelope(np.zeros(4), 1.0, 0.0, 0.0, 0.0, 0.0)
    n, delta = np.stack([one.n for one in scenes]), np.stack([one.delta for one in scenes])
    pairs = combinations(range(delta.shape[1]), 2)
    angle = np.array([angle_between(n[:, i], n[:, j]) for i, j in pairs] or [[0.0]])
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
    """Return, for every family and its kin, the largest error over the envelope of the others.

    Kin (one spacing, or one radius) are left out where at least FEWEST_FAMILIES families are none:
    without the triples 8 mm apart no deep one off the apex would be left.
    """
    groups: dict[str, list[str]] = {one.name: [one.name] for one in scenes}
    families = len(groups)
    for _, kin in sorted({one.kin for one in scenes}):
        names = sorted({one.name for one in scenes if one.kin[1] == kin})
        if len(names) > 1 and families - len(names) >= FEWEST_FAMILIES:
            groups[f"all {kin}"] = names
    return {group: _without(scenes, names) for group, names in groups.items()}


def _without(scenes: Sequence[Measured], names: Sequence[str]) -> float:
    """Return the largest error of the named families over the envelope of the others."""
    coefficients = _coefficients([one for one in scenes if one.name not in names])
    left = [one for one in scenes if one.name in names]
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
    n, delta = np.stack([one.n for one in scenes]), np.stack([one.delta for one in scenes])
    return envelope_terms(n, np.maximum(delta, 0.0))


def _errors(scenes: Sequence[Measured]) -> Array:
    return np.array([one.error for one in scenes])


def largest(nodes: Sequence[float], deepest: Array, errors: Array) -> Array:
    """Return (D,) largest error of all scenes up to each depth node, never falling."""
    return np.array([errors[deepest <= node + _CLOSE].max(initial=0.0) for node in nodes])


def reached(nodes: Sequence[float], deepest: Array) -> Flags:
    """Return (D,) True where a scene is as deep as a node, or nearer to it than to the last."""
    middle = np.array([(a + b) / 2 for a, b in pairwise([0.0, *nodes])])
    return np.asarray(middle <= deepest.max(initial=0.0))


def write(path: Path, tables: Tables, bounds: Bounds) -> str:
    """Write bounds as JSON, rounded up, null for infinity. Returns the sha256 of the file."""
    content: dict[str, Any] = {"tables": tables.digest, "tips": tip_tables.shipped().digest}
    content |= {f.name: _rounded(getattr(bounds, f.name)) for f in fields(Bounds)}
    text = json.dumps(content, allow_nan=False).replace('], "', '],\n"') + "\n"
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)
    return hashlib.sha256(text.encode()).hexdigest()


def _rounded(values: Any) -> Any:
    if isinstance(values, tuple):
        return [_rounded(one) for one in values]
    if isinstance(values, OtherTips):
        envelopes = {name: _rounded(getattr(values, name)) for name in ("single", "pair")}
        return {"smallest": values.smallest, "largest": values.largest, **envelopes}
    if isinstance(values, Envelope):
        up = np.ceil(values.coefficients / _STEP_COEFFICIENT) * _STEP_COEFFICIENT
        rest = {f.name: round(getattr(values, f.name), 4) for f in fields(Envelope)[1:]}
        return {"coefficients": [round(one, 6) for one in up.tolist()], **rest}
    if values.ndim:
        return [_rounded(one) for one in values]
    if math.isinf(values):
        return None
    return round(math.ceil(float(values) / _STEP_MM - _CLOSE) * _STEP_MM, 4)


def _singles(rings: Array, alone: Sequence[Measured]) -> Array:
    """Return (B, D) errors up to a polar angle, where scenes between it and the last reach."""
    polar = np.array([math.acos(min(1.0, one.n[0, 2])) for one in alone])
    deepest, errors = np.array([one.delta[0] for one in alone]), _errors(alone)
    rows = []
    for above, below in pairwise([-1.0, *rings]):
        inside = polar <= below + _CLOSE
        known = reached(DEPTH_MM, deepest[inside & (polar > above + _CLOSE)])
        rows.append(np.where(known, largest(DEPTH_MM, deepest[inside], errors[inside]), np.inf))
    return np.stack(rows)


def _added(coupled: TableMechanics, superposed: TableMechanics, angle: float) -> Array:
    """Return the (D', D') largest difference of the tiers for two contacts so far apart."""
    depths = np.stack(np.meshgrid(ADDED_DEPTH_MM, ADDED_DEPTH_MM, indexing="ij"), axis=-1)
    half, reach = angle / 2, DOME_RADIUS_MM + RADIUS_MM
    n = np.array([[-math.sin(half), 0.0, math.cos(half)], [math.sin(half), 0.0, math.cos(half)]])
    centres = (reach - depths.reshape(-1, 2))[..., None] * n
    height = np.sqrt(reach**2 - (centres[..., :2] ** 2).sum(axis=-1))
    tips = Tips(centres[..., :2], height - centres[..., 2], np.full(len(centres), RADIUS_MM))
    at = CHART.directions().reshape(-1, 3)
    one, other = (tier.displacement(tier.loads(tips), at)[0] for tier in (coupled, superposed))
    apart: Array = np.linalg.norm(one - other, axis=-1).max(axis=-1)
    return np.where(depths.min(axis=-1) > 0, apart.reshape(depths.shape[:2]), 0.0)


def leave_out_lines(tables: Tables, scenes: Sequence[ReferenceScene]) -> list[str]:
    """Return the table of ``leave_out`` for pairs and triples, and for tips of other radii."""
    errors = measure(tables, scenes)
    lines = []
    nominal = [one for one in errors if one.radius == RADIUS_MM]
    kinds = [
        (title, [one for one in nominal if len(one.delta) == count])
        for title, count in (("pairs", 2), ("triples", 3))
    ]
    for low, high in OTHERS_MM:
        single, pair = other_tips(errors, low, high)
        kinds += [(f"singles, R = {low:g} to {high:g} mm", single)]
        kinds += [(f"pairs, R = {low:g} to {high:g} mm", pair)]
    for title, some in kinds:
        found = envelope(some)
        numbers = ", ".join(f"{value:.5f}" for value in found.coefficients)
        lines.append(f"{title}: coefficients {numbers}; factor {found.factor:.2f}")
        lines += [f"  {group:24} {ratio:5.2f}" for group, ratio in leave_out(some).items()]
        names = sorted({one.name for one in some})
        if len(names) < FEWEST_FAMILIES + 2:
            continue
        two = np.array([_without(some, pair) for pair in combinations(names, 2)])
        within = f"{(two <= found.factor).sum()} of {len(two)} within the factor"
        lines.append(f"  two families at once: {within}, at most {two.max():.2f}")
    return lines


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Measure the error bounds of the tiers.")
    parser.add_argument("out", type=output_file, nargs="?")
    parser.add_argument("--leave-out", action="store_true", help="print the test by leaving out")
    given = parser.parse_args()
    shipped = tables.shipped()
    scenes = (*reference.shipped(), *reference.shipped_other_tips().scenes)
    if given.leave_out:
        sys.stdout.write("\n".join(leave_out_lines(shipped, scenes)) + "\n")
    elif given.out is None:
        parser.error("name the file to write, or give --leave-out")
    else:
        write_file(given.out, lambda: write(given.out, shipped, measured(shipped, scenes)))


if __name__ == "__main__":
    main()
