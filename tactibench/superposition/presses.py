"""Frames as displacements of pins, and the single presses among labelled frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, Pose
from tactibench.errors import UserError
from tactibench.images import gray_frames
from tactibench.markers import Tracker

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

_DOUBTFUL = 2.5


@dataclass(frozen=True, eq=False)
class Eye:
    """The pins of one sensor. still: (side, side) gray, the untouched sensor."""

    still: Images
    tracker: Tracker

    @classmethod
    def of(cls, frames: Sequence[Frame], otherwise: Frame | None = None) -> Self:
        """From the rest image that the frames carry, or else from a frame that is hardly pressed.

        Raises UserError where there is neither.
        """
        rest = next((frame.rest for frame in frames if frame.rest is not None), None)
        if rest is None and otherwise is not None:
            rest = otherwise.image
        if rest is None:
            raise UserError(
                "the frames carry no rest image, from which the pins' places are taken; record one "
                "of the untouched sensor, or use a model without pins (unet, cnn)."
            )
        return cls.at(gray_frames([Frame(rest, 0.0, Pose())], max(rest.shape[:2]))[0])

    @classmethod
    def at(cls, still: Images) -> Self:
        """From a gray image of the untouched sensor."""
        return cls(still, Tracker(still))

    @property
    def side(self) -> int:
        return len(self.still)

    @property
    def rest(self) -> Array:
        return self.tracker.rest

    def images(self, frames: Sequence[Frame]) -> Images:
        """(N, side, side) gray."""
        return gray_frames(frames, self.side)

    def moved(self, images: Images) -> Array:
        """(N, 2 P) displacement of every pin: x of all, then y of all, px."""
        return self.watch(images)[0]

    def watch(self, images: Images) -> tuple[Array, npt.NDArray[np.bool_]]:
        """``moved``, and (N, P) whether a pin is surely itself.

        Where pins crowd a tracker may be one pin off, and then one nearby finds no place: pins at
        rest within 2.5 spacings of one that was not seen are doubtful.
        """
        tracks = self.tracker.track(images)
        moved = (tracks.xy - self.rest).transpose(0, 2, 1)
        sure = np.ones(tracks.seen.shape, dtype=np.bool_)
        for row in np.flatnonzero(~tracks.seen.all(axis=1)):
            sure[row] = ~self._around[:, ~tracks.seen[row]].any(axis=1)
        return moved.reshape(len(images), 2 * len(self.rest)), sure

    def again(self, images: Images, moved: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """``moved`` and (N, P) whether a pin was found, of pins that are about ``moved`` (N, 2 P).

        Tells crowded pins apart that ``watch`` could not.
        """
        xy = self.rest + moved.reshape(len(images), 2, -1).transpose(0, 2, 1)
        tracks = self.tracker.refit(images, xy)
        return (tracks.xy - self.rest).transpose(0, 2, 1).reshape(moved.shape), tracks.seen

    @cached_property
    def pitch(self) -> float:
        """Median distance of a pin at rest from its nearest neighbour, px."""
        apart = _distances(self.rest, self.rest)
        apart[np.diag_indices(len(apart))] = np.inf
        return float(np.median(apart.min(axis=1)))

    @cached_property
    def _around(self) -> npt.NDArray[np.bool_]:
        return _distances(self.rest, self.rest) < _DOUBTFUL * self.pitch


def _distances(a: Array, b: Array) -> Array:
    return np.asarray(np.hypot(*(a[:, None] - b).transpose(2, 0, 1)), dtype=np.float64)


def single_presses(truth: Sequence[Answer]) -> npt.NDArray[np.intp]:
    """Rows with exactly one contact. Raises UserError for answers that are no contacts."""
    if not all(isinstance(answer, Contacts) for answer in truth):
        raise UserError(
            "single presses are superposed by contacts, and these frames are labelled with plate "
            "poses; use another model, or leave mixing out."
        )
    return np.flatnonzero([len(answer) == 1 for answer in truth])  # type: ignore[arg-type]


def as_rows(truth: Sequence[Answer]) -> Array:
    """(N, K, 3) x, y, depth mm of answers of K contacts each."""
    return np.stack(
        [
            np.column_stack([answer.xy, answer.depth])
            for answer in truth
            if isinstance(answer, Contacts)
        ]
    )
