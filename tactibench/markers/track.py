"""Pins followed from the rest frame: one position a pin and frame, seen or foretold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.markers.look import Look, look
from tactibench.markers.neighbours import neighbours

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

REFINED = ("profile", "centroid")
SWEEPS = 12


def rest_layout(image: Images) -> Array:
    """(P, 2) px, the pins of an undeformed frame (H, W) uint8, from the top row down.

    Pixel (row i, column j) has its centre at x = j, y = i. Raises UserError for any other array.
    """
    xy, area = _pins(image)
    found = look(image, xy, area)
    return xy if found is None else found.disc[:, :2].copy()


@dataclass(frozen=True, eq=False)
class Tracks:
    """Pins of N frames.

    xy: (N, P, 2) px, never NaN. seen: (N, P), False where a pin is foretold from its neighbours.
    radius: (N, P) px, of the discs that were fitted; NaN where centroids were taken.
    """

    xy: Array
    seen: npt.NDArray[np.bool_]
    radius: Array

    def __len__(self) -> int:
        return len(self.xy)


class Tracker:
    """Finds the pins of one sensor in its frames, every frame on its own.

    Bright blobs are matched to the layout by growth from pins that are sure (``grow``, ``follow``).
    With refinement "profile" soft discs are then fitted to the grey levels, all pins of a frame
    together (``fit``), as they looked at rest; with "centroid" positions are those of the blobs.
    """

    rest: Array
    """(P, 2) px, read-only."""
    refine: str
    """What is done: "profile" or "centroid"."""

    def __init__(self, rest_image: Images, *, refine: str = "auto") -> None:
        """rest_image: (H, W) uint8 of the undeformed sensor.

        refine: "profile", "centroid" or "auto", the profile wherever the rest frame is grey and
        its pins are soft discs. Raises UserError for a frame without pins, of another kind, or
        without the discs that "profile" asks for.
        """
        if refine not in ("auto", *REFINED):
            raise UserError(f"refine is {refine!r}; allowed: auto, {', '.join(REFINED)}.")
        xy, area = _pins(rest_image)
        found = None if refine == "centroid" else look(rest_image, xy, area)
        if found is None and refine == "profile":
            raise UserError(
                "the rest frame shows no soft discs whose profile could be fitted; use refine "
                "centroid or auto."
            )
        self._start(xy if found is None else found.disc[:, :2], rest_image.shape, found)

    @classmethod
    def of_layout(cls, xy: Array, shape: tuple[int, ...]) -> Self:
        """A tracker of pins at xy (P, 2) px at rest in frames of this shape (H, W).

        It takes centroids: how pins look is known from a rest frame only. Raises UserError for a
        layout of fewer than three pins or with NaN.
        """
        tracker = cls.__new__(cls)
        tracker._start(xy, shape, None)
        return tracker

    def _start(self, xy: Array, shape: tuple[int, ...], found: Look | None) -> None:
        rest = np.array(xy, dtype=np.float64, order="C")
        if rest.ndim != 2 or rest.shape[1] != 2 or len(rest) < 3 or not np.isfinite(rest).all():
            raise UserError(
                f"the layout has shape {rest.shape}; it must be (P, 2) with at least three finite "
                "rows."
            )
        rest.setflags(write=False)
        self.rest, self.shape, self.look = rest, (int(shape[0]), int(shape[1])), found
        self.refine = "centroid" if found is None else "profile"
        self._near = neighbours(rest)

    def track(self, images: npt.NDArray[Any]) -> Tracks:
        """The pins of (N, H, W) uint8 frames, N from 0 on. Raises UserError for other arrays."""
        from tactibench.markers.frame import track

        if (
            not isinstance(images, np.ndarray)
            or images.dtype != np.uint8
            or images.ndim != 3
            or images.shape[1:] != self.shape
        ):
            kind = getattr(images, "shape", None), getattr(images, "dtype", type(images).__name__)
            raise UserError(
                f"the frames have shape {kind[0]} and type {kind[1]}; pins are tracked in gray "
                f"frames (N, {self.shape[0]}, {self.shape[1]}) of uint8."
            )
        images = np.ascontiguousarray(images)
        xy = np.empty((len(images), *self.rest.shape))
        seen = np.empty(xy.shape[:2], dtype=np.bool_)
        radius = np.full(xy.shape[:2], np.nan)
        track(images, *self._near, xy, seen)
        self._fit(images, xy, seen, radius)
        return Tracks(xy, seen, radius)

    def refit(self, images: Images, xy: Array) -> Tracks:
        """The pins of frames (N, H, W) of which is known roughly where they are.

        xy: (N, P, 2) px, within about half a spacing. Discs are fitted from there, which tells pins
        apart that overlap; no blob is looked for. A pin whose disc shrinks has no light there and
        is not seen. Where pins are centroids nothing can be fitted: xy comes back, none is seen.
        """
        from tactibench.markers.frame import THERE

        found = np.array(xy, dtype=np.float64, order="C")
        seen = np.full(found.shape[:2], self.look is not None)
        radius = np.full(seen.shape, np.nan)
        self._fit(np.ascontiguousarray(images), found, seen, radius)
        if self.look is not None:
            seen &= radius > THERE * self.look.disc[:, 2]
        return Tracks(found, seen, radius)

    def _fit(self, images: Images, xy: Array, seen: npt.NDArray[np.bool_], radius: Array) -> None:
        """Improve xy and seen, and set the radius, where the discs are known."""
        from tactibench.markers.frame import refine

        if self.look is None:
            return
        usual = np.ascontiguousarray(self.look.disc[:, 2])
        parts = self.look.dark, self.look.contrast, self.look.edge
        refine(images, *parts, usual, self._near.pitch, SWEEPS, xy, seen, radius)


def _pins(image: npt.NDArray[Any]) -> tuple[Array, Array]:
    """(P, 2) centroids px and (P,) areas of the pins of a rest frame."""
    from tactibench.markers.frame import find
    from tactibench.markers.parts import RING

    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != np.uint8:
        kind = getattr(image, "shape", None), getattr(image, "dtype", type(image).__name__)
        raise UserError(
            f"the rest frame has shape {kind[0]} and type {kind[1]}; pins are found in a gray "
            "frame (H, W) of uint8."
        )
    out = np.empty((image.size // 2 + 64, 3))
    run = np.empty((4, image.size // 2 + 64), dtype=np.int32)
    count, usable = find(np.ascontiguousarray(image), RING, run, out)
    found = out[:count][usable]
    if len(found) < 3:
        raise UserError(
            f"the rest frame shows {len(found)} pins; at least three are needed. Give a frame of "
            "the undeformed sensor, with bright pins on a dark ground."
        )
    return np.ascontiguousarray(found[:, :2]), np.ascontiguousarray(found[:, 2])
