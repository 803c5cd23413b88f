"""How many pins the frames of a recording show, and whether they can be followed from rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.datasets.importing import Recording
from tactibench.errors import UserError

SAMPLE = 64


@dataclass(frozen=True)
class Pins:
    """frames: that were looked at. found: pins found in each, 0 where none. rest: pins of the rest
    frame, None without one. followed: share of the frames in which each of them was seen.
    moved: largest displacement of a pin from rest, px, median over the frames."""

    frames: int
    found: tuple[int, ...]
    rest: int | None
    followed: float | None
    moved: float | None


def count_pins(recording: Recording, sample: int = SAMPLE) -> Pins:
    """Look at frames evenly spread over the table."""
    from tactibench.markers import Tracker, rest_layout

    count = min(sample, len(recording))
    rows = np.linspace(0, len(recording) - 1, count).round().astype(int).tolist()
    images = [_gray(recording.image(row)) for row in rows]
    found = []
    for image in images:
        try:
            found.append(len(rest_layout(image)))
        except UserError:  # fewer than three pins
            found.append(0)
    rest = recording.rest_image()
    try:
        tracker = None if rest is None else Tracker(_gray(rest))
    except UserError:
        tracker = None
    if tracker is None:
        return Pins(len(rows), tuple(found), None if rest is None else 0, None, None)
    tracks = tracker.track(np.stack(images))
    away = np.linalg.norm(tracks.xy - tracker.rest, axis=2).max(axis=1)
    return Pins(
        len(rows),
        tuple(found),
        len(tracker.rest),
        float(tracks.seen.all(axis=1).mean()),
        float(np.median(away)),
    )


def _gray(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    if image.ndim == 2:
        return image
    import cv2

    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
