"""Comparison of labels with frames: the depths and places that the frames confirm or contradict.

No model is trained. A deeper press moves pins or channels more; pins spread from the place of the
tip; frames that are alike were pressed at the same place; a label belongs to the frame of its own
row and to no other. Wrong units show in lengths that no soft sensor has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import TypeAdapter

from tactibench.contacts import FloatArray, Scene
from tactibench.datasets.labels import (
    DEG_PER,
    MM_PER,
    PLATE,
    ImportOptions,
    role_columns,
    signed_column,
)
from tactibench.datasets.pivot import (
    FEWEST,
    RecordingFit,
    direction_of,
    fit_recording,
    follow_spreads,
)
from tactibench.datasets.recording import Recording
from tactibench.datasets.schema import ChannelKind
from tactibench.datasets.tables import rank_correlation, rank_of_alike, spread_evenly
from tactibench.errors import UserError
from tactibench.records import (
    cache_folder,
    code_hash,
    combined,
    digest,
    read_checked_json,
    write_checked_json,
)

Kept = TypeVar("Kept")

MOST = 200
"""Most presses that are checked: about a second with 331 pins."""
MOST_ROWS = 4000
"""Most rows of channels: each looks for its likest among all, 3 s; 21,000 rows took 160 s."""
LEAST_RANK = 0.3
"""Least rank correlation of depth with how far the pins or channels move: .75 to .95 where labels
are right, 0 where they belong to other frames, below 0 where depth counts the other way."""
LEAST_RANK_UNRESTED = 0.2
"""The same where movement is measured from the least pressed frame: .4 to .98 with plates, .6 to 1
with tips, at most .14 where depths belong to other frames."""
LEAST_FOLLOWING = 0.3
"""Least correlation of the tilt with the place about which pins spread, measured from the least
pressed frame: .46 to .86 on public recordings; at most .14 where tilts belong to other frames or an
edge was turned."""
_REVERSED = 0.5
"""A rank correlation below minus this is no chance: the depth counts the other way."""
LEAST_PLACED = 0.6
"""Least share of the variance of the place about which pins spread that x and y explain: above .9
where labels are right, below .5 where a column is a wrong one, 0 where they belong to other
frames."""
_FEWEST_FELT = 20
"""Presses that touch from which a rank correlation below the limits is no chance; places that are
alike need as many as a fit, because they must have a neighbour."""
_FEW = 200
"""Fewest rows of which places are compared, where there are so many."""
LEAST_ALIKE = 0.6
"""Least rank correlation of a place with that of the press whose channels are most alike: .99 on
the magnetic skin of eFlesh, 0 where a column belongs to other frames or is no place."""
MOST_STRETCHED = 4.0
"""Largest ratio of the scales of x and y on the frame: 1 to 1.3 where a camera looks along the
axis."""
_DEEPEST_MM, _SHALLOWEST_MM = 30.0, 0.1
"""Limits of the deepest press of a set: no soft sensor gives way farther, or shows less."""
_STEEPEST_DEG = 60.0
"""Steepest tilt: a plate that is tilted further presses with its edge, or the label is the angle of
a robot's tool that hangs down (180 deg)."""
_STILL_MM, _STILL = 0.05, 0.01
"""A label that changes by no more, in mm or deg and as a share of its size, never changes: robots
come back to a few um. In metres all of a recording is small, and its share is not."""
_UNRESTED = "no rest frame: pins are followed from the least pressed frame"
_UNKNOWN = "no rest frame, and no depth that says which frame is least pressed: not checked"
_NOTHING = "all labels are the same in all presses: name the columns that change"
_WIDEST_MM = 200.0
"""Largest distance of a place from the middle: no such sensor is so wide."""


@dataclass(frozen=True)
class LabelReport:
    """The result of a comparison of labels with frames, in sentences.

    Attributes:
        presses: Number of presses that were checked.
        facts: The findings.
        contradictions: Facts that cannot be true at once, with the remedy; empty where all agree.
    """

    presses: int
    facts: tuple[str, ...] = ()
    contradictions: tuple[str, ...] = ()


def check_labels(
    recording: Recording,
    scenes: Sequence[Scene | None],
    options: ImportOptions,
    advance: Callable[[int], None] = lambda _: None,
) -> LabelReport:
    """Compare the labels of a recording with its frames.

    Presses by plates and by single spherical tips are checked; too few of them are no
    contradiction. Without a rest frame the least pressed frame takes its place, and less is asked.
    A label that never changes is not checked.

    Args:
        recording: The recording.
        scenes: Scene of every frame according to its labels.
        options: Columns of a plate's labels.
        advance: Called with the number of frames that were read.
    """
    plates = [row for row, scene in enumerate(scenes) if scene and scene.indenter.is_plate]
    if len(plates) >= FEWEST and recording.labels:
        return _check_plates(recording, options, advance)
    single = [
        s is not None and not s.indenter.is_plate and len(s.indenter.offsets) == 1 for s in scenes
    ]
    return _check_tips(recording, scenes, np.flatnonzero(single), advance)


def _check_plates(
    recording: Recording, options: ImportOptions, advance: Callable[[int], None]
) -> LabelReport:
    wrong: list[str] = []
    try:
        labels = recording.complete_labels()
        columns = role_columns(options, PLATE, labels, recording.table)
        depth = signed_column(labels, columns["depth"], MM_PER, options.unit)
        tilt = signed_column(labels, columns["tilt"], DEG_PER, options.angles)
        wrong += _wrong_plates(depth, tilt)
        rested = recording.rest_image() is not None
        if not wrong and not (rested and changes(depth) and changes(tilt)):
            return _check_unfitted(recording, depth, tilt, advance)
        fit = fit_recording(recording, options, advance, most=MOST)
    except UserError as error:
        return LabelReport(0, (f"not checked: {str(error).rstrip('.')}",), tuple(wrong))
    pivot = fit.pivot
    facts = (
        f"the pins' spread follows the depth with a median misfit of {pivot.residual:.1%}",
        f"the place of the spread follows the tilt with correlation {fit.following:.2f}",
        f"a positive tilt moves the contact to {fit.lean_deg:.0f} deg of the frame (90: down)",
    )
    wrong += filter(None, [fit.contradiction()])
    return LabelReport(pivot.presses + pivot.left_out, facts, tuple(wrong))


def _wrong_plates(depth: FloatArray, tilt: FloatArray) -> list[str]:
    """Return which labels of plates no plate can have, or that none changes."""
    if not changes(depth) and not changes(tilt):
        return [_NOTHING]
    wrong = []
    if np.ptp(depth) > _DEEPEST_MM:
        wrong.append(
            f"the depth label spans {np.ptp(depth):.3g} mm, and no soft sensor gives way by more "
            f"than {_DEEPEST_MM:g}: check the column of the depth and its unit"
        )
    if (steepest := np.abs(tilt).max()) > _STEEPEST_DEG:
        wrong.append(
            f"the tilt reaches {steepest:.3g} deg, and no plate is tilted by more than "
            f"{_STEEPEST_DEG:g}: check the column of the tilt, its zero and its unit"
        )
    return wrong


def _check_unfitted(
    recording: Recording, depth: FloatArray, tilt: FloatArray, advance: Callable[[int], None]
) -> LabelReport:
    """Check plates where a label never changes, or there is no rest frame: nothing is fitted."""
    rows = spread_evenly(len(recording), MOST)
    rested, least = recording.rest_image() is not None, int(rows[np.argmin(depth[rows])])
    if not rested and not changes(depth):
        return LabelReport(0, (_UNKNOWN,))
    _, spread, middle = follow_spreads(recording, rows, advance, least)
    facts = [] if rested else [_UNRESTED]
    wrong = _unfollowed(spread, depth[rows], "pins", facts, rested=rested)
    if not changes(tilt):
        facts.append("the tilt is the same in all presses: not checked")
        return LabelReport(len(rows), tuple(facts), tuple(wrong))
    _, following = direction_of(middle[rows != least], tilt[rows != least])
    facts.append(f"the place of the spread follows the tilt with correlation {following:.2f}")
    if following < LEAST_FOLLOWING:
        wrong.append(
            "the pins do not spread where the plate is tilted to (correlation "
            f"{following:.2f}, at least {LEAST_FOLLOWING:g} is needed)"
        )
    return LabelReport(len(rows), tuple(facts), tuple(wrong))


def _unfollowed(
    moved: FloatArray, depth: FloatArray, noun: str, facts: list[str], *, rested: bool = True
) -> list[str]:
    """Return how the movement of pins or channels contradicts the depth.

    Args:
        moved: (N,) how far they move.
        depth: (N,) mm.
        noun: "pins" or "channels".
        facts: List to which findings are added.
        rested: Whether movement was measured from a rest frame.
    """
    if len(depth) < 3 or not changes(depth):
        known = "not known" if np.isnan(depth).any() else "the same in all presses that touch"
        facts.append(f"the depth is {known}: not checked")
        return []
    rank = rank_correlation(moved, depth)
    facts.append(f"the {noun} move more the deeper the press: rank correlation {rank:.2f}")
    if rank < -_REVERSED:
        return [
            f"the {noun} move less the deeper the label (rank correlation {rank:.2f}): the depth "
            "counts the other way; write -COLUMN for it"
        ]
    least = LEAST_RANK if rested else LEAST_RANK_UNRESTED
    if rank >= least:
        return []
    return [
        f"how far the {noun} move does not follow the depth (rank correlation {rank:.2f}, at "
        f"least {least:g} is needed): the column is another one, or rows are shifted"
    ]


def _check_tips(
    recording: Recording,
    scenes: Sequence[Scene | None],
    singles: npt.NDArray[np.intp],
    advance: Callable[[int], None],
) -> LabelReport:
    x, y, depth = (
        np.array([math.nan if s is None else getattr(s.pose, name) for s in scenes])
        for name in ("x", "y", "depth")
    )
    if len(singles) >= FEWEST and not any(changes(v[singles]) for v in (x, y, depth)):
        return LabelReport(0, (), (_NOTHING,))
    touched = singles[~(depth[singles] <= 0)]  # the others have no place
    felt = len({recording.presses[row] for row in touched.tolist()})
    if len(singles) < FEWEST or felt < _FEWEST_FELT:
        return LabelReport(0, (f"fewer than {FEWEST} presses by one tip or a plate: not checked",))
    wrong = _wrong_units(x[touched], y[touched], depth[touched])
    facts: list[str] = []
    channels = isinstance(recording.kind, ChannelKind)
    rows = touched[spread_evenly(len(touched), MOST_ROWS if channels else MOST)]
    places, deep = np.column_stack([x, y])[rows], depth[rows]
    rested = channels or recording.rest_image() is not None
    if not rested:
        if not changes(depth[singles]):
            return LabelReport(0, (_UNKNOWN,), tuple(wrong))
        facts.append(_UNRESTED)
    try:
        if channels:
            away = _deviations(recording, rows)
            moved = np.sqrt(np.square(away).mean(axis=1))
            of = np.array(recording.presses)[rows]
            misplaced = [] if felt < FEWEST else _unlike(away, places, of, facts)
        else:
            least = int(singles[np.argmin(depth[singles])])
            _, moved, middle = follow_spreads(recording, rows, advance, least)
            misplaced = _misplaced(middle, places, facts)
    except UserError as error:
        return LabelReport(0, (f"not checked: {str(error).rstrip('.')}",), tuple(wrong))
    wrong += _unfollowed(moved, deep, "channels" if channels else "pins", facts, rested=rested)
    wrong += misplaced
    return LabelReport(len(rows), tuple(facts), tuple(wrong))


def changes(label: FloatArray) -> bool:
    """Return whether a label changes by more than a robot is off; False where it is not known."""
    spread = float(np.ptp(label)) if label.size else 0.0  # a label that is not known
    return spread > min(_STILL_MM, _STILL * float(np.abs(label).max(initial=0.0)))


def cached_report(
    recording: Recording, scenes: Sequence[Scene | None], options: ImportOptions
) -> LabelReport:
    """Return the result of ``check_labels``, which is kept in the cache."""
    stated = options.changed()
    return _cached(LabelReport, recording, stated, lambda: check_labels(recording, scenes, options))


def cached_fit(recording: Recording, options: ImportOptions) -> RecordingFit:
    """Return the result of ``fit_recording``, which is kept in the cache.

    Args:
        recording: Presses of a flat plate.
        options: Columns of depth and tilt.

    Raises:
        UserError: The recording cannot be fitted, see ``fit_recording``, or its pins contradict the
            labels.
    """
    columns = [options.depth, options.tilt]
    fit = _cached(RecordingFit, recording, columns, lambda: fit_recording(recording, options))
    if contradiction := fit.contradiction():
        raise UserError(
            f"the labels of {recording.folder} give no indentation: {contradiction}; correct the "
            "table or its columns, or state depth_offset_mm and pivot_mm yourself."
        )
    return fit


def _cached(kind: type[Kept], recording: Recording, options: Any, make: Callable[[], Kept]) -> Kept:
    """Return a result that is kept; equal recordings, options and code have one file."""
    code = combined([code_hash("tactibench.markers"), code_hash("tactibench.datasets")])
    key = digest({"recording": recording.sha256, "options": options, "code": code})
    path, form = cache_folder() / "labels" / f"{kind.__name__}-{key[:24]}.json", TypeAdapter(kind)
    with suppress(UserError):
        kept: Kept = form.validate_python(read_checked_json(path))
        return kept
    path.parent.mkdir(parents=True, exist_ok=True)
    result = make()
    write_checked_json(path, form.dump_python(result))
    return result


def _wrong_units(x: FloatArray, y: FloatArray, depth: FloatArray) -> list[str]:
    wrong = []
    deepest, widest = float(depth.max()), float(max(np.abs(x).max(), np.abs(y).max()))
    if changes(depth) and not _SHALLOWEST_MM <= deepest <= _DEEPEST_MM:
        wrong.append(
            f"the deepest press would be {deepest:.3g} mm deep: check the column of the depth, its "
            "sign, its zero (offset_mm) and its unit"
        )
    if widest > _WIDEST_MM or (widest < _SHALLOWEST_MM / 10 and np.ptp(x) + np.ptp(y) > 0):
        unit = "are these metres? Then rename x and y to x [m], y [m]"
        wrong.append(
            f"places would reach {widest:.3g} mm from the middle: "
            f"{unit if widest < _WIDEST_MM else 'check zeros and unit'}"
        )
    return wrong


def _deviations(recording: Recording, rows: npt.NDArray[np.intp]) -> FloatArray:
    """Return (N, C) deviations of channels from rest, over the mean absolute deviation.

    Where the sensor at rest is not known, the medians take its place.

    Raises:
        UserError: No channel changes.
    """
    values = np.stack([recording.signal(row).ravel() for row in rows.tolist()]).astype(np.float64)
    rest = recording.rest_signal()
    centred = values - (np.median(values, axis=0) if rest is None else np.ravel(rest))
    scale = np.abs(centred).mean(axis=0)
    if not (scale > 0).any():
        raise UserError("no channel changes.")
    return np.asarray(centred[:, scale > 0] / scale[scale > 0])


def _unlike(
    channels: FloatArray, xy: FloatArray, presses: npt.NDArray[np.str_], facts: list[str]
) -> list[str]:
    """Return how channels that are alike contradict the places x and y of their presses.

    The quarter of the rows counts that changes most: the noise of a touch that is hardly felt has
    no place.

    Args:
        channels: (N, C) channels of every row.
        xy: (N, 2) places, mm.
        presses: (N,) names of presses; a press is not compared with itself.
        facts: List to which findings are added.
    """
    size = np.square(channels).mean(axis=1)
    strong = np.argsort(-size, kind="stable")[: max(_FEW, len(size) // 4)]
    channels, xy, presses = channels[strong], xy[strong], presses[strong]
    wrong = []
    for name, column in zip("xy", xy.T, strict=True):
        rank = rank_of_alike(channels, column, presses) if changes(column) else None
        if rank is None:
            continue
        facts.append(f"presses with channels alike have {name} alike: rank correlation {rank:.2f}")
        if rank < LEAST_ALIKE:
            short = f"rank correlation {rank:.2f}, at least {LEAST_ALIKE:g} is needed"
            what = "it is another column, or rows are shifted"
            wrong.append(f"presses with channels alike have no {name} alike ({short}): {what}")
    return wrong


def _misplaced(middle: FloatArray, xy: FloatArray, facts: list[str]) -> list[str]:
    """Return how the places about which pins spread contradict x and y.

    Args:
        middle: (N, 2) places about which the pins spread, px.
        xy: (N, 2) places of the labels, mm.
        facts: List to which findings are added.
    """
    if not changes(xy[:, 0]) or not changes(xy[:, 1]):
        facts.append("x or y is the same in all presses: not checked")
        return []
    slope, share = fit_places(middle, xy)
    matrix = slope[1:].T  # px of the frame by mm
    scales = np.linalg.svd(matrix, compute_uv=False)
    facts.append(f"x and y explain {share:.0%} of where the pins spread")
    if share < LEAST_PLACED:
        return [
            f"the pins do not spread where x and y say ({share:.0%} explained, at least "
            f"{LEAST_PLACED:.0%} is needed): the columns are others, or rows are shifted"
        ]
    if scales[0] > MOST_STRETCHED * scales[1]:
        return [
            f"one of x and y is {scales[0] / scales[1]:.1f} times as long on the frame as the "
            "other: one column is another, or has another unit"
        ]
    if np.linalg.det(matrix) < 0:
        return [
            "x and y are mirrored on the frame: they are swapped, or one counts the other way "
            "(write -COLUMN); x goes right and y down where the camera is not turned"
        ]
    turn = math.degrees(math.atan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1]))
    facts.append(f"the camera is turned by {turn:.0f} deg against x and y")
    return []


def fit_places(middle: FloatArray, places: FloatArray) -> tuple[FloatArray, float]:
    """Fit the places about which pins spread by a straight line of the labels.

    Args:
        middle: (N, 2) px.
        places: (N, K) labels, mm.

    Returns:
        (1 + K, 2) offset and slopes, px and px by mm, and the share that the labels explain.
    """
    terms = np.column_stack([np.ones(len(places)), places])
    keep = np.ones(len(places), dtype=bool)
    for _ in range(3):  # a press that hardly touches has no place: its residual is left out
        slope = np.linalg.lstsq(terms[keep], middle[keep], rcond=None)[0]
        off = np.linalg.norm(middle - terms @ slope, axis=1)
        keep = off <= 4 * np.median(off)
    inside, fitted = middle[keep], terms[keep] @ slope
    left = ((inside - fitted) ** 2).sum() / ((inside - inside.mean(axis=0)) ** 2).sum()
    return np.asarray(slope, dtype=np.float64), 1 - float(left)
