"""How good a sensor is, from a recording alone: no model is trained.

A signal is what pins or channels show. Frames that were pressed at one place with one depth tell
repeatability and drift apart: the signal of a group is its mean, plus a slope times the time, plus
a scatter. Where no place was pressed twice, a cubic of the labels takes the place of the groups,
and the scatter is that between presses whose labels are nearest.

The bound is linear: with J the slope of the signal by the labels and S the covariance of its
scatter, no unbiased answer has a smaller covariance than (J' S^-1 J)^-1 (Cramer and Rao).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from tactibench.datasets.folder import stuck_channels
from tactibench.datasets.formats import same_places
from tactibench.datasets.labels import ImportOptions, Labels, shear_columns
from tactibench.datasets.pivot import middle_of_spread
from tactibench.datasets.plausibility import changes, fit_places
from tactibench.datasets.recording import Recording, label_values, unit_of
from tactibench.datasets.roles import is_time
from tactibench.datasets.schema import ChannelKind
from tactibench.datasets.tables import spread_evenly
from tactibench.errors import UserError, read_file
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.images import gray

FloatArray = npt.NDArray[np.float64]

MOST_FOLLOWED = 5000
"""Most frames whose pins are followed: half a minute with 331 black and white pins."""
MOST_ROWS = 20_000
"""Most rows of channels."""
MOST_FITTED = 1500
"""The same where soft discs are fitted to pins, which takes five times as long."""
_BATCH = 32
_COMPONENTS, _ROWS_A_COMPONENT = 200, 10
"""Most principal components of the signal in which its covariance is taken, and rows that each
needs. With 20 in place of 200 the depth of 331 pins looks half as exact."""
_REPEATS = 30
"""Fewest presses that repeat an earlier one, so that their scatter is known to 13 %."""
_DEGREE, _TERMS = 8, 200
"""Largest degree of the polynomial of the labels, and most terms: the magnets of eFlesh need eight
over 30 mm."""
_ROWS_A_TERM = 8
"""Rows that a term of the polynomial needs; otherwise its degree is lower."""
_LEAST_PRESSES = 10 * _ROWS_A_TERM
"""Presses from which a bound is told: ten terms are those of degree 2 in x, y and depth."""
_APART = 0.1
"""Least share of the time's variance that the labels leave, so that drift is told from them."""
_DIFFERS = 3.0
"""A press differs from rest where its signal is so many times what it scatters at rest."""
_IN_A_ROW, _SURE = 20, 0.95
"""Number of presses in order of depth of which this share differs from rest, from there on."""
_STILL = 0.1
"""A pin that moves less than this share of what pins usually do is no pin: a reflection."""
_FAULTY = 0.01
"""Share of frames, pins or pixels that may be faulty before that is what limits a sensor."""


@dataclass(frozen=True)
class Measure:
    """One line of a report.

    Attributes:
        name: What was measured.
        value: The value; None where it could not be measured, and the remark says why.
        unit: Its unit.
        remark: What it was taken from, in words.
    """

    name: str
    value: float | None
    unit: str
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Signals:
    """The signal of frames, and where they were pressed.

    Attributes:
        values: (N, F) displacements of pins, px, or channels.
        poses: Label, such as "x" -> (N,) mm or deg; those of a press first.
        asked: Number of them that a model shall answer; the others change the signal, too.
        times: (N,) times or numbers of the rows.
        resting: (N,) whether a frame touches nothing.
        rest: (F,) signal of the undeformed sensor; None where it is not known.
        unit: Unit of the signal.
    """

    values: FloatArray
    poses: Labels
    asked: int
    times: FloatArray
    resting: npt.NDArray[np.bool_]
    rest: FloatArray | None = None
    unit: str = ""


@dataclass(frozen=True, eq=False)
class SensorReport:
    """How good a sensor is.

    Attributes:
        measures: The lines of the report.
        limit: What limits the sensor, in one sentence.
        course: Time, and by how much the signal drifted until then, of ten stretches of time.
        presses: Depth and size of the signal of every press.
    """

    measures: tuple[Measure, ...]
    limit: str
    unit: str = ""
    course: tuple[FloatArray, FloatArray] | None = None
    presses: tuple[FloatArray, FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class _Scatter:
    """Scatter and drift of a signal.

    Attributes:
        residual: (N, F) signal without what labels and drift explain.
        freedom: Degrees of freedom of the residual.
        drift: (F,) drift from first to last; None where it cannot be told from the labels.
        drift_std: Standard deviation of each of its numbers.
        repeated: Whether enough frames have the same labels.
        course: Time and drift until then, in ten stretches.
    """

    residual: FloatArray
    freedom: float
    repeated: bool
    drift: FloatArray | None = None
    drift_std: float = 0.0
    course: tuple[FloatArray, FloatArray] | None = None

    @property
    def size(self) -> float:
        """Root mean square scatter."""
        return _rms(self.residual) * math.sqrt(len(self.residual) / max(self.freedom, 1.0))


def measure_signals(signals: Signals, faults: Sequence[str] = ()) -> SensorReport:
    """Return noise, repeatability, drift, threshold and bound of signals.

    Args:
        signals: Signals of frames with known poses.
        faults: What else is wrong with the sensor, in words, the worst first.
    """
    lines: list[Measure] = []
    unit, values = signals.unit, signals.values
    at_rest = np.flatnonzero(signals.resting)
    noise = None
    if len(at_rest) >= 3:  # each frame against those before and after it: drift cancels
        at_rest = at_rest[np.argsort(signals.times[at_rest], kind="stable")]
        time, level = signals.times[at_rest], values[at_rest]
        later = ((time[1:-1] - time[:-2]) / np.maximum(time[2:] - time[:-2], 1e-12))[:, None]
        steps = level[1:-1] - (1 - later) * level[:-2] - later * level[2:]
        noise = _rms(steps / np.sqrt(1 + (1 - later) ** 2 + later**2))
        text = f"from {len(at_rest):,} frames that touch nothing"
    else:
        text = "fewer than three frames touch nothing"
    lines.append(Measure("noise at rest", noise, unit, text))
    poses = np.column_stack(list(signals.poses.values()) or [np.arange(float(len(values)))])
    groups = np.where(signals.resting, -1, same_places(poses))
    scatter = _scatter(signals, poses, groups)
    text = "too few presses have the same labels again"
    if scatter.repeated:
        text = f"{len(values):,} frames, {len(np.unique(groups)):,} different presses"
    again = scatter.size if scatter.repeated else None
    lines.append(Measure("repeatability (the same press again)", again, unit, text))
    drift, text = None, "labels follow the order in time: drift cannot be told from them"
    if scatter.drift is not None:
        drift = _rms(scatter.drift)
        text = f"+- {scatter.drift_std:.2g}; straight line from the first to the last frame"
    lines.append(Measure("drift over the recording", drift, unit, text))
    bounds = _bounds(signals, poses, scatter) if signals.asked else {}
    source = "of repeats" if scatter.repeated else "that labels leave: models may do better"
    for name, (bound, shift) in bounds.items():
        text = f"standard deviation; linear, from the scatter {source}"
        lines.append(Measure(f"best possible {name}", bound, unit_of(name), text))
        if scatter.drift is not None:
            text = "what the drift does to an answer that does not know of it"
            lines.append(Measure(f"shift of {name} by drift", shift, unit_of(name), text))
    hold, presses = again if noise is None else noise, None
    if signals.rest is not None and "depth" in signals.poses:
        size = np.sqrt(np.square(values - signals.rest).mean(axis=1))
        presses = signals.poses["depth"][~signals.resting], size[~signals.resting]
        lines.append(_smallest_press(*presses, hold))
    count = int((~signals.resting).sum()) if signals.asked else 0
    limit = _limit(bounds, faults, count, repeated=scatter.repeated)
    return SensorReport(tuple(lines), limit, unit, scatter.course, presses)


def _scatter(signals: Signals, poses: FloatArray, groups: npt.NDArray[np.int64]) -> _Scatter:
    """Take what labels and drift explain off a signal."""
    _, member, counts = np.unique(groups, return_inverse=True, return_counts=True)
    pressed = groups[groups >= 0]
    repeats = len(pressed) - len(np.unique(pressed))
    repeated = repeats >= max(_REPEATS, len(pressed) // 10)
    time = signals.times - signals.times.mean()
    columns = np.column_stack([time, signals.values])
    if repeated:
        sums = np.zeros((len(counts), columns.shape[1]))
        np.add.at(sums, member, columns)
        columns = columns - (sums / counts[:, None])[member]
        freedom = float(len(groups) - len(counts))
    else:
        terms = _terms(_scaled(poses), _degree(poses.shape[1], len(poses)))
        columns = columns - terms @ np.linalg.lstsq(terms, columns, rcond=None)[0]
        freedom = float(len(groups) - terms.shape[1])
    left, residual = columns[:, 0], columns[:, 1:]
    square, span = float(left @ left), float(np.ptp(time))
    scatter = _Scatter(residual, freedom, repeated)
    if square <= _APART * float(time @ time) * (freedom / len(groups)):
        return scatter
    slope = left @ residual / square
    scatter = _Scatter(residual - np.outer(left, slope), freedom - 1, repeated)
    along = residual @ slope / max(_rms(slope) * len(slope), 1e-12)
    std = scatter.size * span / math.sqrt(square)
    square_drift = max(_rms(slope * span) ** 2, 1e-24)
    shrink = math.sqrt(max(1 - std**2 / square_drift, 0.0))  # a part of its square is scatter
    parts = np.array_split(np.argsort(left, kind="stable"), min(10, len(left)))
    return replace(
        scatter,
        drift=slope * span * shrink,
        drift_std=std,
        course=(
            np.array([left[p].mean() for p in parts]),
            np.array([along[p].mean() for p in parts]),
        ),
    )


def _bounds(
    signals: Signals, poses: FloatArray, scatter: _Scatter
) -> dict[str, tuple[float, float]]:
    """Return asked label -> its bound, and by how much the drift moves it; {} for few rows."""
    rows = np.flatnonzero(~signals.resting)
    if len(rows) < _LEAST_PRESSES:
        return {}
    deviation = signals.values.std(axis=0)
    weight = np.divide(1.0, deviation, out=np.zeros_like(deviation), where=deviation > 0)
    if signals.unit == "px":  # pins are alike
        weight[:] = 1.0
    centred = (signals.values[rows] - signals.values[rows].mean(axis=0)) * weight
    freedom = scatter.freedom if scatter.repeated else float(len(rows))
    most = min(_COMPONENTS, int(freedom) // _ROWS_A_COMPONENT)
    basis = np.linalg.svd(centred, full_matrices=False)[2][:most].T
    residual = (scatter.residual * weight) @ basis
    scaled = _scaled(poses)
    if not scatter.repeated:
        from scipy.spatial import cKDTree

        near = cKDTree(scaled[rows]).query(scaled[rows], k=2)[1][:, 1]
        residual = (residual[rows] - residual[rows][near]) / math.sqrt(2)
    # The inverse of a covariance from few rows is too large by this factor (Wishart).
    covariance = residual.T @ residual / (freedom - basis.shape[1] - 1)
    covariance += (1e-9 * np.trace(covariance) + 1e-18) * np.eye(len(covariance))
    degree = _degree(poses.shape[1], len(np.unique(poses[rows], axis=0)))
    fitted = np.linalg.lstsq(_terms(scaled[rows], degree), centred @ basis, rcond=None)[0]
    half = np.maximum(np.ptp(poses, axis=0) / 2, 1e-12)

    def slope(label: int) -> FloatArray:  # (N, Q) signal by mm or deg
        step = 1e-4 * np.eye(len(half))[label]
        over, below = _terms(scaled[rows] + step, degree), _terms(scaled[rows] - step, degree)
        return np.asarray((over - below) @ fitted / (2e-4 * half[label]))

    slopes = np.stack([slope(label) for label in range(len(half))], axis=1)
    whitened = slopes @ np.linalg.inv(covariance)
    inverse = np.linalg.pinv(whitened @ slopes.transpose(0, 2, 1))
    bound = np.median(np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)), axis=0)
    drift = np.zeros(len(weight)) if scatter.drift is None else scatter.drift
    moved = np.median(np.abs(inverse @ (whitened @ ((drift * weight) @ basis))[..., None]), axis=0)
    asked = list(signals.poses)[: signals.asked]
    pairs = zip(bound.tolist(), moved[:, 0].tolist(), strict=True)
    return dict(zip(asked, pairs, strict=False))


def _smallest_press(depth: FloatArray, size: FloatArray, noise: float | None) -> Measure:
    """Return the depth from which presses differ from rest."""
    name, unit = "smallest press that differs from rest", "mm"
    if noise is None:
        return Measure(name, None, unit, "neither frames at rest nor repeats tell the noise")
    order = np.argsort(depth, kind="stable")
    differs = size[order] > _DIFFERS * noise
    for start in range(len(order) - _IN_A_ROW):
        if differs[start : start + _IN_A_ROW].mean() >= _SURE:
            text = "the shallowest one does" if start == 0 else f"{_DIFFERS:g} times the scatter"
            return Measure(name, float(depth[order[start]]), unit, text)
    return Measure(name, None, unit, "no depth from which presses differ")


def _limit(
    bounds: Mapping[str, tuple[float, float]], faults: Sequence[str], count: int, *, repeated: bool
) -> str:
    """Return in a sentence what limits a sensor."""
    if faults:
        return f"The recording limits the sensor: {faults[0]}."
    if not bounds:
        few = f"{count:,} presses have labels of one contact, and {_LEAST_PRESSES} are needed"
        return f"What limits the sensor cannot be said: {few}."
    times, name = max((shift / max(bound, 1e-12), n) for n, (bound, shift) in bounds.items())
    if times > 1:
        shift = f"{bounds[name][1]:.2g} {unit_of(name)}, {times:.1f} times the scatter of a press"
        moved = f"moves {name} by {shift}"
        return f"Drift limits the sensor: over the recording it {moved}; zero it more often."
    best = " and ".join(f"{b:.2g} {unit_of(name)} in {name}" for name, (b, _) in bounds.items())
    less = "" if repeated else ", or a little less: no press was repeated"
    return f"Scatter limits the sensor: the best model of single frames is off by {best}{less}."


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def _scaled(poses: FloatArray) -> FloatArray:
    low, high = poses.min(axis=0), poses.max(axis=0)
    return np.asarray(2 * (poses - low) / np.maximum(high - low, 1e-12) - 1)


def _degree(labels: int, presses: int) -> int:
    """Return the largest degree whose terms have enough different presses."""
    most = min(_TERMS, presses // _ROWS_A_TERM)
    return max((d for d in range(_DEGREE + 1) if math.comb(labels + d, d) <= most), default=0)


def _terms(scaled: FloatArray, degree: int) -> FloatArray:
    """Return (N, T) products of up to so many columns."""
    powers = range(1, degree + 1)
    chosen = [c for p in powers for c in combinations_with_replacement(range(scaled.shape[1]), p)]
    ones = np.ones(len(scaled))
    return np.column_stack([ones, *(np.prod(scaled[:, each], axis=1) for each in chosen)])


def report_sensor(
    recording: Recording, options: ImportOptions, advance: Callable[[int], None] = lambda _: None
) -> SensorReport:
    """Return how good the sensor of a recording is.

    Args:
        recording: A recording of images with pins, or of channels.
        options: Columns of a plate's labels.
        advance: Called with the number of frames whose pins were followed.

    Raises:
        UserError: A frame cannot be read, or no pins are found in the rest frame.
    """
    poses, asked, resting = _poses(recording, options)
    times, ordered = _times(recording)
    if isinstance(recording.kind, ChannelKind):
        unit, found = "as recorded", _channels(recording, poses)
    else:
        unit, found = "px", _pins(recording, poses, advance)
    rows, values, rest, lines, faults = found
    frozen = _frozen(recording)
    remark = f"of {len(recording):,}: equal to the one before"
    lines += [Measure("frozen frames", frozen, "frames", remark), ordered]
    if frozen > _FAULTY * len(recording):
        faults.insert(0, f"{frozen:,} frames {remark}")
    there = np.isfinite(np.column_stack([*poses.values(), times])[rows]).all(axis=1)
    kept, values = rows[there], values[there]
    if rest is None and resting[kept].any():
        rest = np.median(values[resting[kept]], axis=0)
    at = {name: column[kept] for name, column in poses.items()}
    signals = Signals(values, at, asked, times[kept], resting[kept], rest, unit)
    report = measure_signals(signals, faults)
    turns = _hysteresis(recording, signals, kept)
    return replace(report, measures=(*lines, *report.measures, turns))


def _poses(
    recording: Recording, options: ImportOptions
) -> tuple[dict[str, FloatArray], int, npt.NDArray[np.bool_]]:
    """Return label -> (N,) values, how many of them are asked, and which frames touch nothing.

    Frames of several tips have NaN.
    """
    scenes = recording.scenes
    if not any(scenes):
        try:
            scenes, _ = recording.plate_scenes(options)
        except UserError:
            return {}, 0, np.zeros(len(recording), dtype=bool)
    single = [s is not None and s.sites is None and len(s.indenter.offsets) == 1 for s in scenes]
    plate = any(s is not None and s.indenter.is_plate for s in scenes)
    values = label_values(replace(recording, scenes=scenes))
    poses = {
        name: np.where(single, values[f"pose.{name}"], math.nan)
        for name in (("tilt", "depth") if plate else ("x", "y", "depth"))
    }
    resting = np.array([s is not None and s.pose.depth <= 0 and not plate for s in scenes])
    asked = {n: v for n, v in poses.items() if any(single) and changes(v[np.isfinite(v)])}
    dragged = {name: recording.labels[name] for name in shear_columns(recording.labels)}
    return asked | dragged, len(asked), resting


def _times(recording: Recording) -> tuple[FloatArray, Measure]:
    """Return the times of frames, or the numbers of their rows, and how many are out of order."""
    columns: dict[str, Sequence[Any]] = {n: c.tolist() for n, c in recording.labels.items()}
    columns |= recording.extra
    joined = str(recording.about.get("options", {}).get("join", ""))
    if recording.dataset is not None:
        extra = [recording.dataset.samples[row].extra for row in recording.rows]
        columns |= {name: [each.get(name, "") for each in extra] for name in extra[0]}
    name = "times out of order"
    for column in (c for c in (joined, *filter(is_time, columns)) if c in columns):
        times = pd.to_numeric(pd.Series(columns[column]), errors="coerce").to_numpy(np.float64)
        if np.isfinite(times).all() and np.ptp(times) > 0:
            return times, Measure(
                name, int((np.diff(times) < 0).sum()), "frames", f"column {column}"
            )
    remark = "no column of the time: rows are taken in their order"
    return np.arange(float(len(recording))), Measure(name, None, "frames", remark)


def _rows(poses: Labels, count: int, most: int) -> npt.NDArray[np.intp]:
    """Return rows spread over a recording; with a press all that repeat it."""
    if count <= most or not poses:
        return spread_evenly(count, most)
    group = same_places(np.nan_to_num(np.column_stack(list(poses.values()))))
    groups = np.unique(group)
    share = spread_evenly(len(groups), max(1, most * len(groups) // count))
    return np.flatnonzero(np.isin(group, groups[share]))


Found = tuple[npt.NDArray[np.intp], FloatArray, "FloatArray | None", list[Measure], list[str]]
"""Rows, their signals, the signal at rest, lines of the report, and faults in words."""


def _channels(recording: Recording, poses: Labels) -> Found:
    """Return the channels, their rest, and which are dead or at a limit."""
    rows = _rows(poses, len(recording), MOST_ROWS)
    values = np.stack([np.ravel(recording.signal(row)) for row in rows.tolist()])
    constant, at_limit = stuck_channels(values)
    rest = recording.rest_signal()
    of = f"of {len(constant)}"
    lines = [
        Measure("dead channels", int(constant.sum()), "channels", f"{of}: never change"),
        Measure("saturated channels", int((at_limit > 0).sum()), "channels", f"{of}: at a limit"),
    ]
    faults = [f"{line.value:.0f} {of} are {line.name}" for line in lines if line.value]
    at_rest = None if rest is None else np.ravel(rest).astype(float)
    return rows, values.astype(float), at_rest, lines, faults


def _pins(recording: Recording, poses: Labels, advance: Callable[[int], None]) -> Found:
    """Return displacements of pins, and how many are found, lost and no pins."""
    from tactibench.markers import Tracker

    rest = recording.rest_image()
    first = gray(recording.image(0) if rest is None else rest)
    tracker = Tracker(first)
    most = MOST_FOLLOWED if tracker.profile is None else MOST_FITTED
    rows = _rows(poses, len(recording), most)

    def follow(batch: npt.NDArray[np.intp]) -> tuple[FloatArray, npt.NDArray[np.bool_], float]:
        images = np.stack([gray(recording.image(int(row))) for row in batch])
        tracks = tracker.track(images)
        return tracks.xy - tracker.rest, tracks.seen, float((images == 255).mean())

    parts = []
    batches = [rows[start : start + _BATCH] for start in range(0, len(rows), _BATCH)]
    with ThreadPoolExecutor(2) as pool:  # pins are followed without the lock of Python
        for batch, part in zip(batches, pool.map(follow, batches), strict=True):
            parts.append(part)
            advance(len(batch))
    moved = np.concatenate([part[0] for part in parts])
    lost = 1 - float(np.concatenate([part[1] for part in parts]).mean())
    pins, travel = len(tracker.rest), moved.std(axis=0).mean(axis=1)
    still = int((travel < _STILL * np.median(travel)).sum())
    lines = [
        Measure("pins found at rest", pins, "pins", f"followed in {len(rows):,} frames"),
        Measure("pins lost", 100 * lost, "%", "of the pins of a frame, hidden or run together"),
        Measure("pins that never move", still, "pins", "reflections, or pins on the rim"),
        *_scales(moved, tracker.rest, {name: column[rows] for name, column in poses.items()}),
    ]
    white = 100 * float(np.mean([part[2] for part in parts]))
    two_levels = np.isin(first, (0, 255)).mean() > 0.5  # a camera's ground is no exact 0
    remark = "black and white, or evenly lit" if two_levels else "white pixels of a frame"
    lines.append(Measure("saturated pixels", None if two_levels else white, "%", remark))
    faults = [f"{lost:.0%} of the pins are lost"] if lost > _FAULTY else []
    if white > 100 * _FAULTY and not two_levels:
        faults.append(f"{white:.0f} % of the pixels are white, so take less light")
    still_px = None if rest is None else np.zeros(2 * pins)
    return rows, moved.reshape(len(rows), -1), still_px, lines, faults


def _scales(moved: FloatArray, rest: FloatArray, poses: Labels) -> list[Measure]:
    """Return by how many px the place about which pins spread moves per mm."""
    axes = {name: poses[name] for name in ("x", "y") if name in poses}
    if "tilt" in poses:  # a plate that is tilted touches the dome beside its apex
        axes = {"x of the plate's contact": DOME_RADIUS_MM * np.sin(np.radians(poses["tilt"]))}
    if not axes:
        return []
    places = np.column_stack(list(axes.values()))
    known = np.isfinite(places).all(axis=1)
    slope, share = fit_places(middle_of_spread(moved[known], rest), places[known])
    sizes = np.linalg.norm(slope[1:], axis=1)
    text = f"labels explain {share:.0%} of the place about which the pins spread"
    return [
        Measure(f"scale along {name}", float(size), "px/mm", text)
        for name, size in zip(axes, sizes, strict=True)
    ]


def _frozen(recording: Recording) -> int:
    """Return how many frames are equal to the one before."""
    if recording.dataset is not None:
        keys = [recording.dataset.samples[row].sha256 for row in recording.rows]
    elif recording.values is not None:
        keys = [row.tobytes().hex() for row in recording.values]
    else:
        keys = [hashlib.sha256(read_file(path)).hexdigest() for path in recording.paths]
    return sum(first == second for first, second in pairwise(keys))


def _hysteresis(recording: Recording, signals: Signals, rows: npt.NDArray[np.intp]) -> Measure:
    """Return how much larger the signal is on the way in than on the way out."""
    name, apart = "hysteresis (way in against way out)", []
    depth = signals.poses.get("depth")
    if depth is None or signals.rest is None:
        return Measure(name, None, "%", "no depth or no rest frame is known")
    size = np.sqrt(np.square(signals.values - signals.rest).mean(axis=1))
    of_press: dict[str, list[int]] = {}
    for at in np.argsort(signals.times, kind="stable").tolist():
        of_press.setdefault(recording.presses[rows[at]], []).append(at)
    for at in of_press.values():
        deepest = int(np.argmax(depth[at]))
        into, out = at[: deepest + 1], at[deepest:][::-1]
        if min(len(into), len(out)) < 3 or (np.diff(depth[into]) < 0).any():
            continue
        common = depth[into] >= depth[out].min()
        back = np.interp(depth[into], depth[out], size[out])
        apart.append(float((size[into] - back)[common].mean() / max(np.ptp(size[at]), 1e-12)))
    if not apart:
        return Measure(name, None, "%", "no press was recorded on both ways")
    text = f"of the range of the signal, {len(apart):,} presses"
    return Measure(name, 100 * float(np.mean(apart)), "%", text)
