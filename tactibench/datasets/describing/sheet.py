"""A contact sheet: frames spread over the labels, each with what is known of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.datasets.describing.labels import known_values, unit_of, varying
from tactibench.datasets.importing import Recording

FloatArray = npt.NDArray[np.float64]

ROWS, COLUMNS = 6, 8
_TILE, _GAP, _ABOVE = 180, 12, 40
"""Pixels: side of a frame, between frames, for the caption above."""
_HEAD_INCHES = 0.6
_SHOWN = 3
_LONGEST = 20
_CANDIDATES = 2000
_FIRST = ("pose.depth", "pose.tilt", "pose.x", "pose.y", "pose_2", "pose_6", "pose_y", "pose_Rz")
"""Labels that say most, where there are several."""


def draw_sheet(path: Path, recording: Recording) -> None:
    """Write the sheet as PNG: from top to bottom the first label grows, along a row the second."""
    from tactibench.board.figures.style import DPI, figure, headline, save

    values = shown_labels(varying(known_values(recording)))
    rows = spread_rows(list(values.values()), len(recording), ROWS * COLUMNS)
    width, height = COLUMNS * (_TILE + _GAP), ROWS * (_TILE + _ABOVE)
    paper = np.full((height, width, 3), 255, dtype=np.uint8)
    made = figure(width / DPI, height / DPI + _HEAD_INCHES)
    made.set_layout_engine("none")
    axes = made.add_axes((0, 0, 1, height / (height + _HEAD_INCHES * DPI)))
    axes.set_axis_off()
    for place, row in enumerate(rows):
        top, left = (place // COLUMNS) * (_TILE + _ABOVE), (place % COLUMNS) * (_TILE + _GAP)
        tile = _tile(recording.image(row))
        y, x = top + _ABOVE, left + _GAP // 2
        paper[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
        axes.text(
            left + (_TILE + _GAP) / 2,
            y - 4,
            caption(recording, values, row),
            fontsize=6,
            ha="center",
            va="bottom",
        )
    axes.imshow(paper, interpolation="nearest", aspect="auto")
    title = recording.folder.resolve().name
    if recording.dataset is not None:
        title = recording.dataset.header.name
    above = ", ".join(f"{name} {unit_of(name)}".strip() for name in values) or "no labels"
    headline(
        made,
        f"{title}: {len(recording):,} frames of {recording.kind}",
        f"{len(rows)} of them, spread over the labels; above each: {above}",
    )
    save(made, path)


def _tile(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """(h, w, 3) that fits a tile, sides in proportion."""
    import cv2

    scale = _TILE / max(image.shape[:2])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    tile = cv2.resize(image, size, interpolation=way)
    return np.asarray(tile if tile.ndim == 3 else np.repeat(tile[..., None], 3, axis=2), np.uint8)


def shown_labels(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """At most three labels, those of the pose first."""
    order = sorted(values, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
    return {name: values[name] for name in order[:_SHOWN]}


def spread_rows(labels: Sequence[FloatArray], frames: int, count: int) -> list[int]:
    """Rows far from each other in the labels: each next one is the farthest from those taken.

    In order of reading: rows of the sheet by the first label, along a row by the second.
    """
    rows = np.linspace(0, frames - 1, min(frames, _CANDIDATES)).round().astype(int)
    if not labels:
        return [
            int(row)
            for row in rows[
                np.linspace(0, len(rows) - 1, min(count, len(rows))).round().astype(int)
            ]
        ]
    points = np.column_stack([column[rows] for column in labels])
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-12)
    taken = [int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    away = np.linalg.norm(points - points[taken[0]], axis=1)
    while len(taken) < min(count, len(rows)):
        far = int(np.argmax(away))
        if far in taken:  # the others have the labels of frames that were taken
            far = next(row for row in range(len(rows)) if row not in taken)
        taken.append(far)
        away = np.minimum(away, np.linalg.norm(points - points[far], axis=1))
    chosen = sorted(taken, key=lambda row: float(points[row, 0]))
    second = min(1, len(labels) - 1)
    lines = [chosen[k : k + COLUMNS] for k in range(0, len(chosen), COLUMNS)]
    return [
        int(rows[row])
        for line in lines
        for row in sorted(line, key=lambda row: float(points[row, second]))
    ]


def caption(recording: Recording, values: Mapping[str, FloatArray], row: int) -> str:
    """Two short lines: the labels that are shown, and the frame's name."""
    name = Path(recording.names[row]).name
    name = name if len(name) <= _LONGEST else f"…{name[1 - _LONGEST :]}"
    numbers = ", ".join(
        f"{column[row]:.1f}°" if unit_of(label) == "deg" else f"{column[row]:.2f}"
        for label, column in values.items()
    )
    return f"{numbers}\n{name}" if numbers else name
