"""Pins tracked from the rest frame: one position per pin and frame, seen or predicted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from tactibench.errors import UserError
from tactibench.markers.blobs import GLARE, RING, find_blobs
from tactibench.markers.matching import fill_unseen, match_pins
from tactibench.markers.profile_fit import PinProfile, fit_discs, fit_profile

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

Index = npt.NDArray[np.int64]

REFINEMENTS = ("profile", "centroid")
_SWEEPS = 12
"""Most sweeps of the fit of discs to a frame."""
MOST_PINS = 2_000
"""More bright spots are noise or texture, and discs fitted to them would take minutes: known
sensors have up to 331 pins."""
_NEIGHBOURS = 10
"""Nearest pins that are neighbours of a pin."""
_OPEN_DEG = 120.0
"""A pin with no neighbour in a sector this wide stands at the border."""
HELD = 0.25
"""Standard deviation, pitches, with which a pin that is not seen is held to its predicted place."""
STRAY = 0.5
"""A fitted pin that ends this many pitches from where it began has caught another's light."""
THERE = 0.7
"""A predicted pin whose disc grows to this share of its radius at rest has found its light."""
BLURRED = 2.0
"""A frame whose misfit exceeds that of the rest frame by this factor is fitted with softer edges,
too: simulated sharp frames of one to three contacts come to 1.5, and a blur of 0.5 px to 2.5."""
FITTED = 2.5
"""Blur is accepted where the misfit is below this factor of the rest frame's: a blur of 0.5 to 1 px
comes to 1.0 to 1.5, and of 1.2 px, where pins run into each other, to 2.8."""
BLUR_STEP_PX, BLUR_STEPS = 0.25, 5
"""Steps in which the blur is sought, and number of the last step."""
TRIALS = 2
"""Sweeps of a step, which starts from the result of the step before. Without sweeps the radii hide
half of a blur of 1 px; twelve sweeps, each step from the start of the sharp discs, cost twice as
much for the same pins."""


def rest_layout(image: Images) -> Array:
    """Return the pins of an undeformed frame (H, W) uint8, (P, 2) px, from the top row down.

    Pixel (row i, column j) has its centre at x = j, y = i.

    Raises:
        UserError: The frame is no (H, W) uint8 array, shows fewer than three pins, or shows more
            bright spots than any sensor has pins.
    """
    xy, area = _find_pins(image)
    profile = fit_profile(image, xy, area)
    return xy if profile is None else profile.disc[:, :2].copy()


def count_pins(image: Images) -> int:
    """Return how many pins an undeformed frame (H, W) uint8 shows, without placing them.

    Raises:
        UserError: The frame is no (H, W) uint8 array, shows fewer than three pins, or shows more
            bright spots than any sensor has pins.
    """
    return len(_find_pins(image)[0])


@dataclass(frozen=True, eq=False)
class Tracks:
    """Pins of N frames.

    Attributes:
        xy: (N, P, 2) px, never NaN.
        seen: (N, P), False where a pin is predicted from its neighbours.
        radius: (N, P) radii of the discs that were fitted, px; NaN where centroids were used.
    """

    xy: Array
    seen: npt.NDArray[np.bool_]
    radius: Array

    def __len__(self) -> int:
        return len(self.xy)


class _Layout(NamedTuple):
    """Neighbours of pins at rest.

    Attributes:
        rest: (P, 2) px.
        near: (P, K) the nearest pins.
        back: (P, R) the pins that have this pin among their nearest, filled up with -1.
        pitch: (P,) mean distance of the four nearest, px.
        border: (B,) pins at the border.
    """

    rest: Array
    near: Index
    back: Index
    pitch: Array
    border: Index


class Tracker:
    """A tracker of the pins of one sensor in its frames, each frame by itself.

    Bright blobs are matched to the layout by growth from certain pins (modules ``growth`` and
    ``matching``). With refinement "profile" soft discs with the profile at rest are then fitted to
    the grey levels, all pins of a frame together (``profile_fit``). With "centroid" positions are
    those of the blobs.

    Attributes:
        rest: (P, 2) px, the pins at rest, read-only.
        refine: The refinement in use, "profile" or "centroid".
        shape: Height and width of the frames.
        profile: The profile of pins at rest; None where the refinement is "centroid".
    """

    def __init__(self, rest_image: Images, *, refine: str = "auto") -> None:
        """Find the pins at rest.

        Args:
            rest_image: (H, W) uint8 of the undeformed sensor.
            refine: "profile", "centroid" or "auto", the profile wherever the rest frame is grey and
                its pins are soft discs.

        Raises:
            UserError: ``refine`` has no such value; the frame is no (H, W) uint8 array or shows no
                pins; or ``refine`` is "profile" and the pins are no soft discs.
        """
        if refine not in ("auto", *REFINEMENTS):
            raise UserError(f"refine is {refine!r}; allowed: auto, {', '.join(REFINEMENTS)}.")
        xy, area = _find_pins(rest_image)
        self.profile: PinProfile | None = None
        if refine != "centroid":
            self.profile = fit_profile(rest_image, xy, area)
        if self.profile is None and refine == "profile":
            raise UserError(
                "the rest frame shows no soft discs whose profile could be fitted; use refine "
                "centroid or auto."
            )
        rest = xy if self.profile is None else self.profile.disc[:, :2]
        self.rest: Array = np.array(rest, dtype=np.float64, order="C")
        self.rest.setflags(write=False)
        self.shape = (int(rest_image.shape[0]), int(rest_image.shape[1]))
        self.refine = "centroid" if self.profile is None else "profile"
        self._layout = _layout_of(self.rest)

    def track(self, images: npt.NDArray[Any]) -> Tracks:
        """Return the pins of (N, H, W) uint8 frames; N may be 0.

        Raises:
            UserError: The frames are no uint8 array of this shape, with the sensor's H and W.
        """
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
        _track_frames(images, self._layout, xy, seen)
        self._refine(images, xy, seen, radius)
        return Tracks(xy, seen, radius)

    def refit(self, images: Images, xy: Array) -> Tracks:
        """Return the pins of frames in which their places are roughly known.

        Discs are fitted from these places, which tells overlapping pins apart; no blob is sought. A
        pin whose disc shrinks has no light there and is not seen. With refinement "centroid"
        nothing can be fitted: xy is returned as it is, and no pin is seen.

        Args:
            images: (N, H, W) uint8.
            xy: (N, P, 2) places, px, right to about half a spacing.
        """
        fitted = np.array(xy, dtype=np.float64, order="C")
        seen = np.full(fitted.shape[:2], self.profile is not None)
        radius = np.full(seen.shape, np.nan)
        self._refine(np.ascontiguousarray(images), fitted, seen, radius)
        if self.profile is not None:
            seen &= radius > THERE * self.profile.disc[:, 2]
        return Tracks(fitted, seen, radius)

    def _refine(
        self, images: Images, xy: Array, seen: npt.NDArray[np.bool_], radius: Array
    ) -> None:
        """Improve xy and seen, and set the radius, where the profile of the pins is known."""
        if self.profile is None:
            return
        usual = np.ascontiguousarray(self.profile.disc[:, 2])
        look = self.profile.dark, self.profile.contrast, self.profile.edge, self.profile.residual
        _fit_frames(images, look, usual, self._layout.pitch, _SWEEPS, xy, seen, radius)


def _find_pins(image: npt.NDArray[Any]) -> tuple[Array, Array]:
    """Return (P, 2) centroids, px, and (P,) areas, px, of the pins of a rest frame.

    Raises:
        UserError: The frame is no (H, W) uint8 array, shows fewer than three pins, or shows more
            bright spots than any sensor has pins.
    """
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != np.uint8:
        kind = getattr(image, "shape", None), getattr(image, "dtype", type(image).__name__)
        raise UserError(
            f"the rest frame has shape {kind[0]} and type {kind[1]}; pins are found in a gray "
            "frame (H, W) of uint8."
        )
    out = np.empty((image.size // 2 + 64, 3))
    run = np.empty((4, image.size // 2 + 64), dtype=np.int32)
    count, usable = find_blobs(np.require(image, requirements=("C", "W")), RING, run, out)
    pins = out[:count][usable]
    if len(pins) < 3:
        raise UserError(
            f"the rest frame shows {len(pins)} pins; at least three are needed. Give a frame of "
            "the undeformed sensor, with bright pins on a dark ground."
        )
    if len(pins) > MOST_PINS:
        raise UserError(
            f"the rest frame shows {len(pins):,} bright spots, which are no pins; take one of the "
            "undeformed sensor in focus, and import raw camera frames with --param light=even."
        )
    return np.ascontiguousarray(pins[:, :2]), np.ascontiguousarray(pins[:, 2])


def _layout_of(rest: Array) -> _Layout:
    """Return the neighbours in a layout (P, 2) px of two pins or more."""
    from scipy.spatial import cKDTree

    count = min(_NEIGHBOURS, len(rest) - 1)
    apart, near = (array[:, 1:] for array in cKDTree(rest).query(rest, k=count + 1))
    near = np.ascontiguousarray(near, dtype=np.int64)
    whose = [np.flatnonzero((near == p).any(axis=1)) for p in range(len(rest))]
    back = np.full((len(rest), max(map(len, whose)) + 1), -1, dtype=np.int64)
    for row, pins in zip(back, whose, strict=True):
        row[: len(pins)] = pins
    step = rest[near] - rest[:, None]
    turn = np.sort(np.arctan2(step[..., 1], step[..., 0]), axis=1)
    gap = np.diff(turn, axis=1, append=turn[:, :1] + 2 * np.pi).max(axis=1)
    pitch = np.maximum(apart[:, :4].mean(axis=1), 1e-6)
    return _Layout(rest, near, back, pitch, np.flatnonzero(gap > np.radians(_OPEN_DEG)))


@njit(cache=True, nogil=True, error_model="numpy")
def _track_frames(images, layout, xy, seen):  # type: ignore[no-untyped-def]
    """Set xy (N, P, 2) px and seen (N, P) from the blobs of the frames (N, H, W) alone."""
    pins = len(layout.rest)
    room = 8 * images.shape[1] + 20 * pins + 64
    run, out = np.empty((4, room), np.int32), np.empty((room, 3))
    which = np.empty(pins, np.int64)
    shape = (images.shape[1], images.shape[2])
    for n in range(len(images)):
        blobs, usable = find_blobs(images[n], GLARE, run, out)
        match_pins(layout, out, blobs, usable, shape, which, xy[n])
        for p in range(pins):
            seen[n, p] = which[p] >= 0
        fill_unseen(layout, which, xy[n])


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_frames(images, look, usual, pitch, sweeps, xy, seen, radius):  # type: ignore[no-untyped-def]
    """Improve xy and seen of ``_track_frames`` by a fit of every frame, and set the radii.

    Where discs with the edges of the rest frame do not fit, the frame is taken to be blurred by as
    much as fits best: a Gaussian of deviation s increases the variance of an edge, edge^2 / 5, by
    s^2.

    Args:
        images: (N, H, W) uint8.
        look: Dark level (H, W), contrast (H, W), edge, px, and residual of the rest frame.
        usual: (P,) radii at rest, px.
        pitch: (P,) mean distance of the four nearest pins, px.
        sweeps: Most sweeps of a fit.
        xy: (N, P, 2) px, where the fits start; is improved.
        seen: (N, P), improved: a pin that was predicted may be found.
        radius: (N, P), set to the radii, px.
    """
    dark, contrast, edge, residual = look
    disc, cover = np.empty((len(usual), 3)), np.empty(dark.shape)
    blurred = np.empty_like(disc)
    held = np.empty(len(usual))
    for n in range(len(images)):
        for p in range(len(usual)):
            held[p] = np.inf if seen[n, p] else HELD * pitch[p]
        _set_discs(xy[n], usual, disc)
        fit_discs(images[n], dark, contrast, edge, usual, held, sweeps, disc, cover)
        least = _misfit(images[n], dark, contrast, cover)
        if least > BLURRED * residual:
            softest = edge
            blurred[:] = disc
            for step in range(2, BLUR_STEPS + 1):
                soft = np.sqrt(edge**2 + 5.0 * (step * BLUR_STEP_PX) ** 2)
                fit_discs(images[n], dark, contrast, soft, usual, held, TRIALS, blurred, cover)
                misfit = _misfit(images[n], dark, contrast, cover)
                if misfit >= least:
                    break
                least, softest = misfit, soft
            fit_discs(images[n], dark, contrast, softest, usual, held, sweeps, blurred, cover)
            if _misfit(images[n], dark, contrast, cover) < FITTED * residual:
                disc[:] = blurred
        for p in range(len(usual)):
            away = np.sqrt((disc[p, 0] - xy[n, p, 0]) ** 2 + (disc[p, 1] - xy[n, p, 1]) ** 2)
            radius[n, p] = disc[p, 2]
            seen[n, p] |= away < STRAY * pitch[p] and disc[p, 2] > THERE * usual[p]
            if away < STRAY * pitch[p]:
                xy[n, p, 0], xy[n, p, 1] = disc[p, 0], disc[p, 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _set_discs(xy, usual, disc):  # type: ignore[no-untyped-def]
    """Set disc (P, 3) to places xy (P, 2) and the usual radii (P,)."""
    disc[:, :2] = xy
    disc[:, 2] = usual


@njit(cache=True, nogil=True, error_model="numpy")
def _misfit(image, dark, contrast, cover):  # type: ignore[no-untyped-def]
    """Return the rms difference between an image and discs that cover (H, W), grey levels."""
    total = 0.0
    for i in range(len(image)):
        for j in range(image.shape[1]):
            light = min(cover[i, j], 1.0)
            total += (image[i, j] - dark[i, j] - contrast[i, j] * light) ** 2
    return np.sqrt(total / image.size)
