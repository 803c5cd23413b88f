"""The fit of offset and pivot to a recording: pins followed in its least sheared presses."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactibench.datasets.importing.geometry import PLATE, roles_of
from tactibench.datasets.importing.options import ImportOptions
from tactibench.datasets.importing.pivot import Pivot, fit_pivot, lean_of, spread_of
from tactibench.datasets.importing.recording import Recording
from tactibench.errors import UserError
from tactibench.records.cache import cache_folder
from tactibench.records.files import read_json, write_json
from tactibench.records.identity import code_hash, combined, digest

FloatArray = npt.NDArray[np.float64]

LEAST_SHEARED = 0.3
"""Share of the presses that is taken where the table says how the plate was dragged along."""
MOST = 1500
"""Presses; more make the scatter smaller than the rest of the uncertainty."""
_CHUNK = 64
_SHEAR = re.compile(r"(move|shear)_([1-6]|[xyz]|R[xyz])")
_TRAVEL = re.compile(r"(move|shear)_[123xyz]")


@dataclass(frozen=True)
class Fitted:
    """pivot: the fit. columns: role -> column. sheared: columns that say how the plate was dragged.
    pins: that were followed. lean_deg: where on the frame a positive tilt moves the contact to, 0:
    right, 90: down."""

    pivot: Pivot
    columns: Mapping[str, str]
    sheared: tuple[str, ...]
    pins: int
    lean_deg: float

    def options(self) -> dict[str, str]:
        """What an import takes to use the fit."""
        return {
            "indenter": PLATE,
            **{role: self.columns[role] for role in ("depth", "tilt")},
            "offset_mm": f"{self.pivot.offset_mm:.3f}",
            "pivot_mm": f"{self.pivot.pivot_mm:.2f}",
        }


def presses_to_fit(recording: Recording) -> int:
    """How many frames ``fit_recording`` reads."""
    return len(_rows(recording, _varying(recording.labels, _TRAVEL)))


def fit_recording(
    recording: Recording, options: ImportOptions, advance: Callable[[int], None] = lambda _: None
) -> Fitted:
    """Follow the pins and fit. ``advance`` is told of frames as they are read.

    Raises UserError without a rest frame, for colour frames, and where labels or presses do not
    suffice.
    """
    from tactibench.markers import Tracker

    known = {n: v for n, v in recording.labels.items() if not np.isnan(v).any()}
    columns = roles_of(options, PLATE, known, recording.table)
    rest = recording.rest_image()
    if rest is None:
        raise UserError(
            f"{recording.folder} has no frame of the undeformed sensor, from which pins are "
            "followed; add one as init_0.png."
        )
    tracker = Tracker(rest)
    sheared = _varying(known, _SHEAR)
    rows = _rows(recording, _varying(known, _TRAVEL))
    spread, shift = np.empty(len(rows)), np.empty((len(rows), 2))
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        tracks = tracker.track(np.stack([recording.image(int(row)) for row in part]))
        moved = tracks.xy - tracker.rest
        spread[start : start + _CHUNK] = spread_of(moved)
        shift[start : start + _CHUNK] = moved.mean(axis=1)
        advance(len(part))
    depth, tilt = (_signed(known, columns[role])[rows] for role in ("depth", "tilt"))
    shear = np.column_stack([known[name][rows] for name in sheared]) if sheared else None
    return Fitted(
        fit_pivot(spread, depth, tilt, shear),
        columns,
        sheared,
        len(tracker.rest),
        lean_of(shift, tilt, shear),
    )


def indentation_options(recording: Recording, options: ImportOptions) -> ImportOptions:
    """The options with the offset and pivot of ``fit_recording``, which are kept in the cache.

    Raises UserError as ``fit_recording``.
    """
    columns = {"depth": options.depth, "tilt": options.tilt}
    code = combined([code_hash("tactibench.markers"), code_hash("tactibench.datasets.importing")])
    key = digest({"recording": recording.sha256, "columns": columns, "code": code})
    path = cache_folder() / "fits" / f"{key[:24]}.json"
    try:
        kept = read_json(path)
        offset, pivot = float(kept["offset_mm"]), float(kept["pivot_mm"])
    except (UserError, KeyError, TypeError, ValueError):
        found = fit_recording(recording, options).pivot
        offset, pivot = found.offset_mm, found.pivot_mm
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, {"offset_mm": offset, "pivot_mm": pivot})
    return replace(options, offset_mm=offset, pivot_mm=pivot)


def _signed(labels: Mapping[str, FloatArray], column: str) -> FloatArray:
    sign = -1.0 if column.startswith("-") else 1.0
    return np.asarray(sign * labels[column.removeprefix("-")], dtype=np.float64)


def _varying(labels: Mapping[str, FloatArray], pattern: re.Pattern[str]) -> tuple[str, ...]:
    return tuple(n for n, v in labels.items() if pattern.fullmatch(n) and np.ptp(v) > 0)


def _rows(recording: Recording, travels: tuple[str, ...]) -> npt.NDArray[np.intp]:
    """The least sheared presses, thinned evenly."""
    rows = np.arange(len(recording))
    if travels:
        square = np.zeros(len(recording))
        for name in travels:
            square += recording.labels[name] ** 2
        rows = np.flatnonzero(square <= np.quantile(square, LEAST_SHEARED))
    if len(rows) > MOST:
        rows = rows[np.linspace(0, len(rows) - 1, MOST).round().astype(np.intp)]
    return rows
