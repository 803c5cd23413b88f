"""Offset and pivot behind the labels of a plate, from how far its presses move the pins.

indentation = z + a + p (1 - cos t) + q sin t, z the depth label, t the tilt label. It is what the
robot travels from first touch; the holder of the dome may give way meanwhile. The spread of a press
is the root mean square displacement of its pins about their mean, which an even shift of all pins
leaves alone. It vanishes at first touch, grows with a power of the indentation, and depends on the
tilt besides only through the perspective of the camera:

    log spread = b + k log(z + a + p (1 - cos t) + q sin t) + c1 t + ... + c4 t^4 + shear

Labels rarely reach first touch, and then the exponent k and the offset a cannot be told apart: k is
taken from simulated plate presses of known indentation, and its uncertainty is part of the result.

Labels that the pins contradict are refused: see ``RecordingFit.contradiction``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from tactibench.datasets.labels import (
    PLATE,
    ImportOptions,
    indentation,
    role_columns,
    shear_columns,
    signed_column,
)
from tactibench.datasets.recording import Recording
from tactibench.datasets.tables import spread_evenly
from tactibench.errors import UserError
from tactibench.images import gray

FloatArray = npt.NDArray[np.float64]

EXPONENT, EXPONENT_STD = 1.37, 0.05
"""k of plates on simulated domes with 331 (1.42) and 127 pins (1.32), 1 to 5 mm deep, up to 20 deg;
with an offset of 5 mm the recordings of Tac-VGNN have 1.37 and 1.39. Simulated presses of the two
calibrated sensors, whose base gives way, get their own offset back with it: 4.91 for 4.91 (331),
5.00 for 5.02 mm (127)."""
PIVOT_BIAS_STD = 1.2
"""mm by which p is off on those simulated presses: perspective changes more than a factor."""
LEAST_SHEARED = 0.3
"""Share of the presses that is fitted where the table says how the plate was dragged along."""
MOST = 1500
"""Most presses that are fitted: more make the scatter smaller than the rest of the uncertainty."""
FEWEST = 50
"""Number of presses below which the fit is not stable."""
FAINT = 0.05
"""A press that moves the pins by less than this share of the strongest may not touch at all."""

MOST_LEFT_OUT = 0.2
"""Share of the presses that may move no pin; none does in the public recordings."""
UNTOUCHED_MM = 0.5
"""Indentation that labels may give at most to presses that move no pin, at their median."""
LEAST_FOLLOWING = 0.6
"""Least correlation of sin t with the place about which the pins spread: .95 and .96 in the public
recordings, 0 where tilts belong to other frames."""
MOST_MISFIT = 0.1
"""Largest misfit, as a share of the spread: .025 and .029 in the public recordings, .14 and .15
where half of the depths are permuted, .40 and .47 where all are, .49 in a recording whose fit left
the sine out."""
FARTHEST_MM = 300.0
"""Largest distance of first touch from label 0, and of the pivot: a robot's tool is no longer. 5
and 21 mm in the public recordings; thousands where a tilt in rad or a depth in um was taken for deg
or mm."""
SHALLOWEST_MM = 0.1
"""A deepest press below this was not given in mm."""

_BATCH = 64
"""Frames whose pins are followed at once."""
_DEGREE = 4
"""Degree in the tilt of the linear terms."""
_NEAREST_MM = 1e-3
"""The smallest indentation in the logarithm, which has no value at 0."""
_ROUNDS = 3
"""Number of fits, each with the scale of the residuals that the one before left."""
_TRAVEL = re.compile(r"(move|shear)_[123xyz]")


@dataclass(frozen=True)
class Pivot:
    """Offset a and pivot p, q of a plate's labels.

    Attributes:
        offset_mm: Offset a.
        pivot_mm: Pivot p, along the axis.
        side_mm: Pivot q, beside the axis.
        offset_std: Standard deviation of a, mm.
        pivot_std: Standard deviation of p, mm.
        side_std: Standard deviation of q, mm.
        offset_scatter: Share of ``offset_std`` that more presses make smaller, mm.
        pivot_scatter: Share of ``pivot_std`` that more presses make smaller, mm.
        residual: Median relative misfit of the spread.
        presses: Number of presses that were fitted.
        left_out: Number of presses that were left out, because they do not move the pins.
    """

    offset_mm: float
    pivot_mm: float
    side_mm: float
    offset_std: float
    pivot_std: float
    side_std: float
    offset_scatter: float
    pivot_scatter: float
    residual: float
    presses: int
    left_out: int


@dataclass(frozen=True)
class RecordingFit:
    """The fit to a recording.

    Attributes:
        pivot: Offset and pivot.
        columns: Role -> column.
        shear: Columns that say how the plate was dragged along.
        pins: Number of pins that were followed.
        lean_deg: Direction on the frame in which a positive tilt moves the contact, 0: right,
            90: down. It is found from the places about which the pins spread.
        following: Correlation of sin t with the place about which the pins spread.
        untouched_mm: Median indentation of the presses that were left out; 0 where there are none.
        deepest_mm: Largest indentation.
    """

    pivot: Pivot
    columns: Mapping[str, str]
    shear: tuple[str, ...]
    pins: int
    lean_deg: float
    following: float
    untouched_mm: float
    deepest_mm: float = math.inf

    def options(self) -> dict[str, str]:
        """Return the options with which an import uses the fit."""
        return {
            "indenter": PLATE,
            **{role: self.columns[role] for role in ("depth", "tilt")},
            "offset_mm": f"{self.pivot.offset_mm:.3f}",
            "pivot_mm": f"{self.pivot.pivot_mm:.2f}",
            "pivot_side_mm": f"{self.pivot.side_mm:.3f}",
        }

    def contradiction(self) -> str:
        """Return in words how the pins contradict the labels; "" where they agree."""
        pivot = self.pivot
        total = pivot.presses + pivot.left_out
        if pivot.left_out > MOST_LEFT_OUT * total:
            return f"{pivot.left_out:,} of {total:,} presses do not move the pins"
        if pivot.residual > MOST_MISFIT:
            return (
                "the pins do not spread as the depth label says (median misfit "
                f"{pivot.residual:.0%}, at most {MOST_MISFIT:.0%} is allowed)"
            )
        if self.untouched_mm > UNTOUCHED_MM:
            return (
                f"{pivot.left_out:,} presses that do not move the pins would be "
                f"{self.untouched_mm:.1f} mm deep at their median"
            )
        farthest = max(abs(pivot.offset_mm), abs(pivot.pivot_mm))
        if farthest > FARTHEST_MM or self.deepest_mm < SHALLOWEST_MM:
            return (
                f"first touch or the pivot would be {farthest:.3g} mm away and the deepest press "
                f"{self.deepest_mm:.3g} mm deep: depth is no mm, or tilt no deg"
            )
        if self.following < LEAST_FOLLOWING:
            return (
                "the pins do not spread where the plate is tilted to (correlation "
                f"{self.following:.2f}, at least {LEAST_FOLLOWING:g} is needed)"
            )
        return ""


def presses_to_fit(recording: Recording) -> int:
    """Return how many frames ``fit_recording`` reads."""
    return len(_least_sheared(recording, shear_columns(recording.labels, _TRAVEL), MOST))


def fit_recording(
    recording: Recording,
    options: ImportOptions,
    advance: Callable[[int], None] = lambda _: None,
    *,
    most: int = MOST,
) -> RecordingFit:
    """Follow the pins of a recording, and fit offset and pivot.

    Args:
        recording: Presses of a flat plate.
        options: Columns of depth and tilt.
        advance: Called with the number of frames that were read.
        most: Largest number of presses that are followed.

    Raises:
        UserError: There is no rest frame, or labels or presses do not suffice.
    """
    labels = recording.complete_labels()
    columns = role_columns(options, PLATE, labels, recording.table)
    dragged = shear_columns(labels)
    rows = _least_sheared(recording, shear_columns(labels, _TRAVEL), most)
    pins, spread, middle = follow_spreads(recording, rows, advance)
    depth, tilt = (signed_column(labels, columns[role])[rows] for role in ("depth", "tilt"))
    shear = None
    if dragged:
        shear = np.column_stack([labels[name][rows] for name in dragged])
    pivot = fit_pivot(spread, depth, tilt, shear)
    untouched = ~_touching(spread)
    deep = indentation(depth, tilt, pivot.offset_mm, pivot.pivot_mm, pivot.side_mm)
    towards, following = direction_of(middle[~untouched], tilt[~untouched])
    return RecordingFit(
        pivot,
        columns,
        dragged,
        pins,
        lean_deg=towards,
        following=following,
        untouched_mm=float(np.median(deep[untouched])) if untouched.any() else 0.0,
        deepest_mm=float(deep.max()),
    )


def follow_spreads(
    recording: Recording,
    rows: npt.NDArray[np.intp],
    advance: Callable[[int], None],
    least: int | None = None,
) -> tuple[int, FloatArray, FloatArray]:
    """Follow the pins of frames, and measure how they spread.

    Args:
        recording: The recording.
        rows: Rows of the frames.
        advance: Called with the number of frames that were read.
        least: Row of the least pressed frame, which stands for a rest frame that is missing.

    Returns:
        Number of pins, (N,) spreads, px, and (N, 2) places about which the pins spread, px.

    Raises:
        UserError: There is no rest frame, or its pins cannot be followed.
    """
    from tactibench.markers import Tracker

    rest = recording.rest_image()
    estimated = rest is None and least is not None
    if rest is None and least is not None:
        rest = recording.image(least)
    if rest is None:
        raise UserError(
            f"{recording.folder} has no frame of the undeformed sensor; add one as init_0.png."
        )
    tracker = Tracker(gray(rest), refine=not estimated)  # discs of a pressed frame fit no other
    spread, middle = np.empty(len(rows)), np.empty((len(rows), 2))
    for start in range(0, len(rows), _BATCH):
        batch = rows[start : start + _BATCH]
        tracks = tracker.track(np.stack([gray(recording.image(int(row))) for row in batch]))
        moved = tracks.xy - tracker.rest
        spread[start : start + _BATCH] = spread_of(moved)
        middle[start : start + _BATCH] = middle_of_spread(moved, tracker.rest)
        advance(len(batch))
    return len(tracker.rest), spread, middle


def _least_sheared(recording: Recording, travels: Sequence[str], most: int) -> npt.NDArray[np.intp]:
    """Return rows of the least sheared presses, thinned evenly."""
    rows = np.arange(len(recording))
    if travels:
        square = np.zeros(len(recording))
        for name in travels:
            square += recording.labels[name] ** 2
        rows = np.flatnonzero(square <= np.quantile(square, LEAST_SHEARED))
    return rows[spread_evenly(len(rows), most)]


def _touching(spread: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray(spread > FAINT * np.quantile(spread, 0.95))


def fit_pivot(
    spread: FloatArray, depth: FloatArray, tilt: FloatArray, shear: FloatArray | None = None
) -> Pivot:
    """Fit offset and pivot to the spreads of presses.

    Args:
        spread: (N,) spreads of the pins, of any unit.
        depth: (N,) labels, mm; larger is deeper.
        tilt: (N,) labels, deg.
        shear: (N, S) labels of how the plate was dragged along.

    Raises:
        UserError: Too few presses touch, or depth or tilt never changes.
    """
    touching = _touching(spread)
    if np.count_nonzero(touching) < FEWEST:
        raise UserError(f"{touching.sum()} presses move the pins; at least {FEWEST} are needed.")
    columns = np.zeros((len(spread), 0)) if shear is None else shear
    spread, depth, tilt, columns = (values[touching] for values in (spread, depth, tilt, columns))
    for name, values in (("depth", depth), ("tilt", tilt)):
        if np.ptp(values) < 1e-6:
            raise UserError(
                f"the {name} label is the same in all presses, so that offset and pivot cannot be "
                "told apart; fit a recording in which it changes, or name another column."
            )
    best, low, high = (
        _fit_exponent(spread, depth, tilt, columns, EXPONENT + change)
        for change in (0.0, -EXPONENT_STD, EXPONENT_STD)
    )
    return replace(
        best,
        left_out=int(np.count_nonzero(~touching)),
        side_std=math.hypot(best.side_std, (high.side_mm - low.side_mm) / 2),
        offset_std=math.hypot(best.offset_scatter, (high.offset_mm - low.offset_mm) / 2),
        pivot_std=math.hypot(
            best.pivot_scatter, (high.pivot_mm - low.pivot_mm) / 2, PIVOT_BIAS_STD
        ),
    )


def _fit_exponent(
    spread: FloatArray, depth: FloatArray, tilt: FloatArray, shear: FloatArray, exponent: float
) -> Pivot:
    """Fit with one exponent; the tails of the residuals weigh linearly (soft l1)."""
    log = np.log(spread)
    lifted, aside = 1 - np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    linear = _linear_terms(tilt / np.abs(tilt).max(), shear)
    count = linear.shape[1]  # x: a, p, the linear terms, q

    def indented(x: FloatArray) -> FloatArray:
        deep = depth + x[0] + x[1] * lifted + x[-1] * aside
        return np.asarray(np.maximum(deep, _NEAREST_MM), dtype=np.float64)

    def residuals(x: FloatArray) -> FloatArray:
        fitted = exponent * np.log(indented(x)) + linear @ x[2 : 2 + count]
        return np.asarray(fitted - log, dtype=np.float64)

    start = np.zeros(3 + count)
    start[0] = 1.0 - depth.min()  # the shallowest press about 1 mm deep
    start[2] = float(log.mean())
    x, scale = start, 0.1
    for _ in range(_ROUNDS):
        solved = least_squares(residuals, x, loss="soft_l1", f_scale=scale, x_scale="jac")
        x = solved.x
        # 1.4826 times the median absolute residual is the standard deviation of a normal law.
        scale = max(float(1.4826 * np.median(np.abs(residuals(x)))), 1e-9)
    misfit = residuals(x)
    # Huber's sandwich for an M-estimate: psi of soft l1 is r / sqrt(1 + (r / scale)^2).
    tail = 1 + (misfit / scale) ** 2
    slope = exponent / indented(x)
    jacobian = np.column_stack([slope, slope * lifted, linear, slope * aside])
    inverse = np.linalg.pinv((jacobian * tail[:, None] ** -1.5).T @ jacobian)
    half = jacobian * (misfit * tail**-0.5)[:, None]
    scatter = np.sqrt(np.diag(inverse @ (half.T @ half) @ inverse))
    offset, pivot, side = x[[0, 1, -1]].tolist()
    a, p, q = scatter[[0, 1, -1]].tolist()
    residual = float(np.median(np.abs(misfit)))
    return Pivot(offset, pivot, side, a, p, q, a, p, residual, presses=len(spread), left_out=0)


def _linear_terms(tilt: FloatArray, shear: FloatArray) -> FloatArray:
    """Return (N, T): one, powers of the tilt (-1..1), and of each shear s, s^2 and s t."""
    columns = [tilt**power for power in range(_DEGREE + 1)]
    for values in shear.T:
        largest = np.abs(values).max()
        if largest > 0:
            scaled = values / largest
            columns += [scaled, scaled**2, scaled * tilt]
    return np.column_stack(columns)


def spread_of(moved: FloatArray) -> FloatArray:
    """Return the root mean square distance of pins' displacements from their mean.

    Args:
        moved: (N, P, 2) displacements of P pins, px.

    Returns:
        (N,) px.
    """
    centred = moved - moved.mean(axis=1, keepdims=True)
    spread: FloatArray = np.sqrt((centred**2).sum(axis=2).mean(axis=1))
    return spread


def middle_of_spread(moved: FloatArray, rest: FloatArray) -> FloatArray:
    """Return the (N, 2) place, px from the mean pin, about which the pins of a press spread.

    The lines through the pins along their displacements pass it closest, in least squares weighted
    by the displacements. An even shift of all pins is taken out first.

    Args:
        moved: (N, P, 2) displacements of P pins, px.
        rest: (P, 2) places of the pins at rest, px.
    """
    centred = moved - moved.mean(axis=1, keepdims=True)
    normal = np.stack([-centred[..., 1], centred[..., 0]], axis=-1)
    places = rest - rest.mean(axis=0)
    square = np.einsum("npi,npj->nij", normal, normal)
    trace = np.trace(square, axis1=1, axis2=2)[:, None, None]
    square += 1e-9 * np.maximum(trace, 1e-9) * np.eye(2)  # nothing moves: the mean pin
    right = np.einsum("npi,npj,pj->ni", normal, normal, places)
    return np.asarray(np.linalg.solve(square, right[..., None])[..., 0], dtype=np.float64)


def direction_of(middle: FloatArray, tilt: FloatArray) -> tuple[float, float]:
    """Return where a positive tilt moves the contact, and how closely the contact follows.

    Args:
        middle: (N, 2) places from ``middle_of_spread``, px.
        tilt: (N,) tilts of the plate, deg.

    Returns:
        Direction on the frame, deg, 0: right, 90: down; correlation of the place along it with
        the sine of the tilt.
    """
    sine = np.sin(np.radians(tilt))
    slope = np.linalg.lstsq(np.column_stack([np.ones(len(sine)), sine]), middle, rcond=None)[0][1]
    along = middle @ slope
    alike = float(np.corrcoef(along, sine)[0, 1]) if np.ptp(along) > 0 else 0.0
    return math.degrees(math.atan2(slope[1], slope[0])), alike
