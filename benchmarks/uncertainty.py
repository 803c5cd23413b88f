"""Compare errors of stored runs with the Cramer-Rao bound and with the errors that models state.

    python benchmarks/uncertainty.py runs/exp1-* runs/exp2-* runs/exp3-*
    python benchmarks/uncertainty.py NAME NAME --store runs       names in a store

The presses are drawn again from the protocol and compared with the truth of the run; the sensor of
the run gives their Cramer-Rao bounds. For a press of one contact, the prediction with the highest
score counts, without a gate. For several contacts, the pairs inside the protocol's gate count, and
the share that is missed is printed beside them. Prints figures by number of contacts, then the
verdict on means over runs that differ only in their seed. Exit code 1 when no model reaches some
target.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import erfinv

from tactibench.contacts import Contacts, FloatArray, Scene
from tactibench.errors import UserError
from tactibench.geometry import true_contacts
from tactibench.metrics import Trials, uncertainty
from tactibench.plugins import PluginHost, SensorContext
from tactibench.protocols import draw_scenes, load_protocol, pressable
from tactibench.records import Record, StoredRun, digest, open_run, unpack_contacts

AXES = ("x", "y", "z")
PERCENT = (50, 90, 95)
DEPTH_MM = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
SPACING_MM = (6.25, 7.25, 8.25, 9.25, 10.25, 11.25, 12.25)
"""Edges of the bins: between the distances that the protocols press, so that none is on an edge."""
NAMES = {1: "single", 2: "dual", 3: "triple"}
BUDGET_S = 60.0
"""Time for the bounds of one run; where it is too short, only every n-th press has a bound."""
FEWEST = 20
"""Least number of pairs in a bin that is judged."""
SINGLE, DUAL = 4.0, 6.0
OVERALL, BIN = (0.92, 0.98), 0.85

LINES = (
    ("rmse_over_bound", 2),
    ("typical_over_bound", 2),
    ("bias_over_bound", 2),
    ("bias_mm", 5),
    ("std_over_bound", 2),
    ("std_over_bound_p50", 2),
    ("rms_z", 3),
    ("typical_z", 3),
)
"""Figures by axis and their digits; `typical` are medians in place of root mean squares."""
SEEDED = {"seed", "weights", "weights_hash", "predictions_hash", "stored", "commit", "machine"}
"""Parts of a run's identity that its seed changes, or that change no figure."""
MEDIAN = 0.674490
"""Median of the absolute value of a unit Gaussian."""

Figures = dict[str, float]
Verdict = tuple[str, str, bool]
"""Target (in the same words for all models), measured value, and whether it meets the target."""
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Table:
    """Pairs of predicted and true contacts in the presses of a run with one number of contacts.

    Attributes:
        error: (P, 3) errors of x, y and depth, predicted - true, mm.
        std: (P, 3) standard deviations that the model states, mm; NaN where it states none.
        bound: (P, 3) Cramer-Rao bounds, mm; NaN where they are not known.
        depth: (P,) true depths, mm.
        spacing: (P,) true distances to the nearest other contact, mm.
        missed: Share of the true contacts that are missed.
        spurious: Number of spurious contacts a frame.
    """

    error: FloatArray
    std: FloatArray
    bound: FloatArray
    depth: FloatArray
    spacing: FloatArray
    missed: float
    spurious: float


def scenes_of(stored: StoredRun, truth: Sequence[Contacts]) -> tuple[list[Scene], Any]:
    """Return the presses of a run, drawn again, and its sensor.

    Raises:
        UserError: The run has recorded frames, or was made of other presses than those that its
            protocol draws now.
    """
    protocol = load_protocol(stored.record.protocol.id).spec
    spec = PluginHost().sensors[stored.record.sensor.name]
    if spec.needs_data:
        raise UserError(f"{stored.folder.name} has recorded frames, of which nobody knows a bound.")
    given = {name: str(value) for name, value in stored.record.sensor.parameters.items()}
    sensor = spec.build(SensorContext(np.random.SeedSequence(0)), **spec.settings(given))
    pressed = pressable(protocol, sensor)
    names = [str(name).rpartition("-") for name in stored.arrays("truth")["press"]]
    draws = {name: draw_scenes(pressed, name).scenes for name in {draw for draw, _, _ in names}}
    scenes = [draws[draw][int(row)] for draw, _, row in names]
    if digest(sensor.describe()) != digest(stored.record.identity.sensor["describe"]):
        print("note: the sensor is not quite the one of the run")
    again = [true_contacts(scene, pressed.workspace.dome_radius_mm) for scene in scenes]
    if not all(_same(contacts, true) for contacts, true in zip(again, truth, strict=True)):
        raise UserError(
            f"{stored.folder.name} was not made of the presses that its protocol draws now; "
            "run the protocol again."
        )
    return scenes, sensor


def _same(one: Contacts, other: Contacts) -> bool:
    return len(one) == len(other) and all(
        np.allclose(a, b, rtol=0, atol=1e-6)
        for a, b in ((one.xy, other.xy), (one.depth, other.depth))
    )


def bounds(sensor: Any, scenes: Sequence[Scene], truth: Sequence[Contacts]) -> list[FloatArray]:
    """Return the (K, 3) bounds of every press, mm; NaN where they are left out or not known.

    Args:
        sensor: Sensor of the run.
        scenes: Presses of the run.
        truth: True contacts of every press.
    """
    unknown = [np.full((len(true), 3), np.nan) for true in truth]
    if sensor.bound(scenes[0]) is None:  # the first call compiles
        print("bounds: the sensor knows none")
        return unknown
    began = time.perf_counter()
    tried = np.linspace(0, len(scenes) - 1, min(20, len(scenes))).astype(int)
    bound = {int(row): sensor.bound(scenes[row]) for row in tried}
    each = (time.perf_counter() - began) / len(tried)
    step = max(1, int(np.ceil(each * len(scenes) / BUDGET_S)))
    for row in range(0, len(scenes), step):
        bound.setdefault(row, sensor.bound(scenes[row]))
    took = time.perf_counter() - began
    print(
        f"bounds: {len(bound):,} of {len(scenes):,} presses, {took:.1f} s, {each * 1e3:.1f} ms each"
    )
    return [bound.get(row, nothing) for row, nothing in enumerate(unknown)]


def tables(stored: StoredRun) -> dict[int, Table]:
    """Return number of true contacts -> pairs of a run.

    Raises:
        UserError: The run was answered with plates, has recorded frames, or was made of other
            presses than those that its protocol draws now.
    """
    arrays = stored.arrays("truth")
    if "xy" not in arrays:
        raise UserError(f"{stored.folder.name} was answered with plates; name runs of contacts.")
    truth = unpack_contacts(arrays)
    predictions = unpack_contacts(stored.arrays("predictions"))
    scenes, sensor = scenes_of(stored, truth)
    bound = bounds(sensor, scenes, truth)
    gate = load_protocol(stored.record.protocol.id).spec.test.gate_mm
    out = {}
    for count in sorted({len(true) for true in truth} - {0}):
        rows = [row for row, true in enumerate(truth) if len(true) == count]
        out[count] = _table(
            Trials(
                tuple(truth[row] for row in rows),
                tuple(predictions[row] for row in rows),
                arrays["press"][rows],
                ("all",) * len(rows),
                gate=gate,
            ),
            [bound[row] for row in rows],
            count,
        )
    return out


def _table(trials: Trials, bound: Sequence[FloatArray], count: int) -> Table:
    gated = trials.matched
    true = len(trials) * count
    missed = 1 - len(gated.trial) / true
    spurious = float(trials.predicted_counts.sum() - len(gated.trial)) / len(trials)
    if count == 1:
        first = tuple(_first(answer) for answer in trials.predictions)
        trials = replace(trials, predictions=first, gate=np.inf)
    pairs = trials.matched
    at = list(zip(pairs.trial, pairs.truth, strict=True))
    error = np.column_stack(
        [pairs.predicted_xy - pairs.true_xy, pairs.predicted_depth - pairs.true_depth]
    )
    stated = [
        np.full(3, np.nan) if (std := trials.predictions[i].std) is None else std[j]
        for i, j in zip(pairs.trial, pairs.prediction, strict=True)
    ]
    near = [uncertainty.spacing(contacts.xy) for contacts in trials.truth]
    return Table(
        error,
        np.array(stated).reshape(-1, 3),
        np.array([bound[i][j] for i, j in at]).reshape(-1, 3),
        pairs.true_depth,
        np.array([near[i][j] for i, j in at]),
        missed,
        spurious,
    )


def _first(answer: Contacts) -> Contacts:
    std = None if answer.std is None else answer.std[:1]
    return Contacts(answer.xy[:1], answer.depth[:1], answer.score[:1], std)


def figures(table: Table) -> Figures:
    """Return all figures of a table by name; those about std only where the model states it."""
    out: Figures = {"missed": table.missed, "spurious": table.spurious, "pairs": len(table.error)}
    rmse, bias = over_bound(table.error, table.bound)
    for a, axis in enumerate(AXES):
        out[f"rmse_over_bound {axis}"] = float(rmse[a])
        out[f"bias_over_bound {axis}"] = float(bias[a])
        out[f"bias_mm {axis}"] = float(table.error[:, a].mean()) if len(table.error) else np.nan
        out[f"typical_over_bound {axis}"] = (
            _median(np.abs(table.error[:, a] / table.bound[:, a])) / MEDIAN
        )
    has = np.isfinite(table.std).all(axis=1)
    if not has.any():
        return out
    std, bound = table.std[has], table.bound[has]
    z = table.error[has] / std
    out["nll"] = float(uncertainty.gaussian_loss(z, std).mean())
    for a, axis in enumerate(AXES):
        out[f"rms_z {axis}"] = float(np.sqrt((z[:, a] ** 2).mean()))
        out[f"typical_z {axis}"] = _median(np.abs(z[:, a])) / MEDIAN
        out[f"std_over_bound {axis}"] = float(over_bound(std, bound)[0][a])
        out[f"std_over_bound_p50 {axis}"] = _median(std[:, a] / bound[:, a])
    depth, near = table.depth[has], table.spacing[has]
    for name, chosen in _bins(depth, near):
        out[f"pairs {name}"] = float(chosen.sum())
        for q in PERCENT:
            inside = uncertainty.in_ellipse(z[chosen], q), in_interval(z[chosen, 2], q)
            out[f"ellipse_{q} {name}"], out[f"depth_{q} {name}"] = (float(i.mean()) for i in inside)
    return out


def in_interval(z: FloatArray, percent: float) -> npt.NDArray[np.bool_]:
    """Return whether each z lies in the interval that holds ``percent`` % of one Gaussian.

    The interval is symmetric: |z| <= sqrt(2) erfinv(percent / 100).
    """
    inside = np.abs(z) <= math.sqrt(2) * float(erfinv(percent / 100))
    return np.asarray(inside, dtype=np.bool_)


def over_bound(error: FloatArray, bound: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (A,) RMSE and (A,) bias of errors, both over the root mean square bound.

    These are sqrt(sum e^2 / sum b^2) and mean e / sqrt(mean b^2): rmse^2 = bias^2 + scatter^2, and
    1 is the smallest RMSE that an unbiased estimate can have. Pairs whose b is not finite are left
    out, axis by axis; an axis without a finite bound has NaN.

    Args:
        error: (P, A) errors e.
        bound: (P, A) Cramer-Rao standard deviations b, in the unit of the errors.
    """
    bounded = np.isfinite(bound)
    count = bounded.sum(axis=0)
    e, b = np.where(bounded, error, 0.0), np.where(bounded, bound, 0.0)
    with np.errstate(invalid="ignore"):
        scale = np.sqrt((b**2).sum(axis=0) / count)
        rmse = np.sqrt((e**2).sum(axis=0) / count) / scale
        bias = e.sum(axis=0) / count / scale
    return np.asarray(rmse, dtype=np.float64), np.asarray(bias, dtype=np.float64)


def _median(values: FloatArray) -> float:
    """Return the median of the finite values; NaN where there are none."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else np.nan


def _bins(depth: FloatArray, near: FloatArray) -> Iterator[tuple[str, Mask]]:
    """Yield name and members of all pairs together, and of every bin that is not empty.

    Args:
        depth: (P,) true depths, mm.
        near: (P,) true distances to the nearest other contact, mm.
    """
    yield "all", np.ones(len(depth), dtype=np.bool_)
    for label, values, edges in (("depth", depth, DEPTH_MM), ("spacing", near, SPACING_MM)):
        # The last edge belongs to the last bin: tips are pressed exactly that deep.
        place = np.digitize(values.round(9), (*edges[:-1], np.nextafter(edges[-1], np.inf)))
        for k in np.unique(place[np.isfinite(values)]):
            low = f"{edges[k - 1]:g}" if k else ""
            high = f"{edges[k]:g}" if k < len(edges) else ""
            yield f"{label} {low}..{high} mm", (place == k) & np.isfinite(values)


def show(found: Figures) -> None:
    """Print the figures of one table."""

    def line(name: str, digits: int) -> str:
        values = [found.get(f"{name} {axis}", np.nan) for axis in AXES]
        return f"  {name:20}" + "".join(f"{_text(v, digits):>10}" for v in values)

    print(
        f"  {found['pairs']:.0f} pairs, missed {found['missed']:.4f}, "
        f"spurious {found['spurious']:.4f} by frame\n  {'':20}" + "".join(f"{a:>10}" for a in AXES)
    )
    for name, digits in LINES:
        print(line(name, digits))
    print(f"  {'nll':20}{_text(found.get('nll', np.nan), 3):>10}")
    if "nll" not in found:
        print(f"  {'coverage':20}{'n/a':>10}   the model states no std")
        return
    heads = [f"{kind}_{percent}" for kind in ("ellipse", "depth") for percent in PERCENT]
    print(f"  {'coverage':24}{'pairs':>8}" + "".join(f"{head:>12}" for head in heads))
    for name in _bin_names(found):
        values = "".join(f"{found[f'{head} {name}']:12.3f}" for head in heads)
        print(f"  {name:24}{found[f'pairs {name}']:8.0f}{values}")


def _bin_names(found: Figures) -> list[str]:
    return [name.removeprefix("pairs ") for name in found if name.startswith("pairs ")]


def _text(value: float, digits: int) -> str:
    return "n/a" if np.isnan(value) else f"{value:.{digits}f}"


def mean(of: Sequence[Figures]) -> Figures:
    """Return the means over runs of the figures that all of them have."""
    return {
        name: float(np.mean([run[name] for run in of]))
        for name in of[0]
        if all(name in run for run in of)
    }


def judge(regime: str, count: int, found: Figures) -> Iterator[Verdict]:
    """Yield a verdict on every target of such a table; targets of std only where it is stated.

    Args:
        regime: Regime of the training.
        count: Number of true contacts.
        found: Figures of the table.
    """
    kind = NAMES.get(count, str(count))
    most = SINGLE if count == 1 else DUAL if (count, regime) == (2, "multiple") else None
    ratios = [found[f"rmse_over_bound {axis}"] for axis in AXES]
    if most is not None and not np.isnan(ratios).any():
        measured = " ".join(f"{axis} {ratio:.2f}" for axis, ratio in zip(AXES, ratios, strict=True))
        yield f"{kind} rmse_over_bound <= {most:g}", measured, max(ratios) <= most
    if "nll" not in found:
        return
    share, (low, high) = found["ellipse_95 all"], OVERALL
    asked = f"{kind} 95 % ellipses {low:g} to {high:g} overall"
    yield asked, f"{share:.3f}", low <= share <= high
    judged = [n for n in _bin_names(found) if n != "all" and found[f"pairs {n}"] >= FEWEST]
    if judged:
        worst = min(judged, key=lambda name: found[f"ellipse_95 {name}"])
        share = found[f"ellipse_95 {worst}"]
        asked = f"{kind} 95 % ellipses >= {BIN:g} in any bin"
        yield asked, f"{share:.3f} in {worst}", share >= BIN


def _word(met: bool) -> str:
    return "PASS  " if met else "FAIL  "


def _but_seed(record: Record) -> str:
    """Return a digest of a run's identity that is equal for runs that differ only in their seed."""
    identity = {k: v for k, v in record.identity.json_values().items() if k not in SEEDED}
    return digest([record.model.identity, record.regime, identity])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", help="names in the store, or folders")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="the run store")
    asked = parser.parse_args()
    groups: dict[tuple[str, str, str, int], list[Figures]] = {}
    for name in asked.runs:
        stored = open_run(asked.out, name)
        record = stored.record
        print(f"\n{stored.folder.name}", flush=True)
        title = f"{record.protocol.id} {record.model.name} {record.regime}"
        for count, table in tables(stored).items():
            print(f"{title}, {NAMES.get(count, count)}")
            run_figures = figures(table)
            show(run_figures)
            key = (_but_seed(record), title, record.regime, count)
            groups.setdefault(key, []).append(run_figures)
    print(f"\nmeans over seeds; bins of fewer than {FEWEST} pairs are shown and not judged")
    met: dict[str, bool] = {}
    for (_, title, regime, count), of in groups.items():
        for asked_for, measured, reached in judge(regime, count, mean(of)):
            print(f"{_word(reached)}{title} ({len(of)}): {asked_for}: {measured}")
            target = f"{title.split()[0]} {regime}: {asked_for}"
            met[target] = met.get(target, False) or reached
    print("\nany of these models")
    for target, reached in met.items():
        print(_word(reached) + target)
    return int(not all(met.values()))


if __name__ == "__main__":
    raise SystemExit(main())
