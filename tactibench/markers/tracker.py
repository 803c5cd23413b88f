"""Pins tracked from the rest frame: one position per pin and frame, seen or predicted.

Pins as soft discs that are fitted together to the grey levels of a frame.

A frame is modelled as dark(x, y) + contrast(x, y) min(1, sum of the discs), with each disc

    s(a) = a^2 (3 - 2 a),   a = (radius + edge - distance) / (2 edge) within 0..1

averaged over a pixel by four points. Centres and radii are found by weighted least squares, pin by
pin in turn with the others' light taken off (block Gauss-Seidel), so that pins which overlap do not
pull at each other. A radius is free because pins come nearer to the camera, but is held loosely to
that at rest. Dark level, contrast, edge and usual radii are those of the sensor at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from tactibench.errors import UserError
from tactibench.markers.blobs import GLARE, RING, find_blobs
from tactibench.markers.matching import fill_unseen, match_pins

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

READ, SHOT = 2.3, 0.0255
"""Variance of a pixel: READ + SHOT x level (1.5 levels of read noise, 10,000 electrons at 255).
It only sets the weights of pixels; a camera with other noise loses little."""
LOOSE = 0.2
"""Standard deviation, as a share of the radius at rest, by which a radius is held to it."""
LARGEST_STEP = 0.6
"""Largest step of a pin in one sweep, px."""
STILL = 2e-4
"""A pin whose last step was shorter is fitted, px."""
_OFF = 0.25
"""A pixel is averaged over four points, the midpoints of its quarters: their distance from its
centre along x and y, px."""
SOFTEST, SHARPEST = 3.0, 0.35
"""Limits between which the half-width of an edge is sought, px."""
FAITHFUL = 0.06
"""A profile is used where it fits the rest frame to this rms, as a share of the contrast."""
_ROUNDS = 3
"""Rounds in which discs are fitted, then the polynomials of dark level and contrast."""
_AROUND = 2.5
"""Width of the ground around a pin that takes part in the fit at rest, px."""


@dataclass(frozen=True, eq=False)
class PinProfile:
    """The profile of pins at rest.

    Attributes:
        dark: (H, W) grey levels without light.
        contrast: (H, W) grey levels of full light over dark ones.
        edge: Half-width of a disc's edge, px.
        disc: (P, 3) x, y and radius, px.
        residual: Rms difference between the rest frame around its pins and the fit, grey levels.
    """

    dark: Array
    contrast: Array
    edge: float
    disc: Array
    residual: float


def fit_profile(image: Images, xy: Array, area: Array) -> PinProfile | None:
    """Return the profile of the pins in a rest frame.

    Dark level and contrast are polynomials, of degree 4 for 60 pins and more: light falls off
    towards the rim.

    Args:
        image: (H, W) uint8, the rest frame.
        xy: (P, 2) centres of the pins, px.
        area: (P,) areas of the pins, px.

    Returns:
        The profile. None where there is nothing to fit: the frame is black and white, has fewer
        than three pins, or its pins are no soft discs.
    """
    if len(xy) < 3 or np.count_nonzero(np.bincount(image.ravel(), minlength=256)) < 8:
        return None
    disc = np.column_stack([xy, np.sqrt(area / np.pi)])
    return _fit_from(image.tobytes(), image.shape, disc.tobytes())


@lru_cache(maxsize=32)  # a fit takes 0.2 s, and models of one process see the same few sensors
def _fit_from(pixels: bytes, shape: tuple[int, int], discs: bytes) -> PinProfile | None:
    """Return the profile of pins as ``fit_profile`` does, from arguments that can be cached.

    Args:
        pixels: Bytes of the rest frame, uint8.
        shape: Height and width of the rest frame.
        discs: Bytes of (P, 3) x, y and radius, px, where the search begins.
    """
    from scipy.optimize import minimize_scalar

    image = np.frombuffer(pixels, dtype=np.uint8).reshape(shape).copy()
    disc = np.frombuffer(discs).reshape(-1, 3).copy()
    xy = disc[:, :2]
    best: list[PinProfile] = []

    def misfit(edge: float) -> float:
        best.append(_profile_with(image, best[-1].disc if best else disc, float(edge)))
        return best[-1].residual

    minimize_scalar(misfit, bounds=(SHARPEST, SOFTEST), method="bounded", options={"xatol": 2e-3})
    profile = min(best, key=lambda each: each.residual)
    contrast = float(np.median(profile.contrast[tuple(np.rint(xy[:, ::-1]).astype(int).T)]))
    return profile if contrast > 0 and profile.residual < FAITHFUL * contrast else None


def _profile_with(image: Images, disc: Array, edge: float) -> PinProfile:
    """Return the best profile whose edge has the half-width ``edge``, px."""
    start, disc = disc, disc.copy()
    level = image.astype(np.float64)
    terms = _terms(image.shape, 4 if len(disc) >= 60 else 2 if len(disc) >= 20 else 0)
    near = _near(image.shape, disc)
    cover = np.empty(image.shape)
    dark = np.full(image.shape, np.percentile(level[near], 5))
    contrast = np.full(image.shape, np.percentile(level[near], 98)) - dark
    free = np.full(len(disc), np.inf)
    residual = np.inf
    for _ in range(_ROUNDS):
        fit_discs(image, dark, contrast, edge, disc[:, 2].copy(), free, 8, disc, cover)
        if not np.isfinite(disc).all():  # a rim or texture, and no discs
            return PinProfile(dark, contrast, edge, start, np.inf)
        light = np.minimum(cover[near], 1.0)
        basis = np.concatenate([terms[near], terms[near] * light[:, None]], axis=1)
        weights, *_ = np.linalg.lstsq(basis, level[near], rcond=None)
        residual = float(np.sqrt(np.mean((basis @ weights - level[near]) ** 2)))
        dark, contrast = (terms @ half for half in np.split(weights, 2))
    return PinProfile(dark, np.maximum(contrast, 1.0), edge, disc, residual)


def _terms(shape: tuple[int, ...], degree: int) -> Array:
    """Return the products of powers of x and y, (H, W, T), with x and y scaled to -1..1."""
    y, x = (np.linspace(-1, 1, side) for side in shape)
    powers = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    return np.stack([y[:, None] ** a * x[None] ** b for a, b in powers], axis=-1)


def _near(shape: tuple[int, ...], disc: Array) -> npt.NDArray[np.bool_]:
    """Return (H, W), True around pins; light beyond, such as reflections, is not theirs."""
    out = np.zeros(shape, dtype=np.bool_)
    for x, y, radius in disc:
        wide = radius + _AROUND
        rows = slice(max(0, int(y - wide)), int(y + wide) + 2)
        columns = slice(max(0, int(x - wide)), int(x + wide) + 2)
        out[rows, columns] = True
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _add_disc(x, y, radius, edge, sign, cover):  # type: ignore[no-untyped-def]
    """Add a disc, times ``sign``, to cover (H, W)."""
    height, width = cover.shape
    reach = radius + edge
    wide = reach + _OFF
    per = 0.5 / edge
    left, right = max(0, math.ceil(x - wide)), min(width - 1, math.floor(x + wide))
    top, bottom = max(0, math.ceil(y - wide)), min(height - 1, math.floor(y + wide))
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            total = 0.0
            for half in range(4):
                dy = i - y + (_OFF if half & 1 else -_OFF)
                dx = j - x + (_OFF if half & 2 else -_OFF)
                a = min(max((reach - math.sqrt(dx * dx + dy * dy)) * per, 0.0), 1.0)
                total += a * a * (3.0 - 2.0 * a)
            cover[i, j] += sign * 0.25 * total


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _normal_equations(image, dark, contrast, cover, x, y, radius, edge, m):  # type: ignore[no-untyped-def]
    """Set m (9,) to the weighted sums of a least squares step in x, y and radius of one disc.

    With the Jacobian's columns x, y and r these are xx, xy, xr, yy, yr and rr, then the products of
    x, y and r with the residual.
    """
    height, width = cover.shape
    reach = radius + edge
    wide = reach + _OFF
    per = 0.5 / edge
    left, right = max(0, math.ceil(x - wide)), min(width - 1, math.floor(x + wide))
    top, bottom = max(0, math.ceil(y - wide)), min(height - 1, math.floor(y + wide))
    m[:] = 0.0
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            if cover[i, j] > 1.0:
                continue  # full light: nothing is learned from it
            gx, gy, gr = 0.0, 0.0, 0.0
            for half in range(4):
                dy = i - y + (_OFF if half & 1 else -_OFF)
                dx = j - x + (_OFF if half & 2 else -_OFF)
                away = math.sqrt(dx * dx + dy * dy) + 1e-12
                a = min(max((reach - away) * per, 0.0), 1.0)
                slope = a * (1.0 - a)
                gx += slope * dx / away
                gy += slope * dy / away
                gr += slope
            level = dark[i, j] + contrast[i, j] * cover[i, j]
            weight = 1.0 / (READ + SHOT * level)
            scale = 0.25 * 6.0 * per * contrast[i, j]
            gx, gy, gr = gx * scale, gy * scale, gr * scale
            rest = (image[i, j] - level) * weight
            m[0] += weight * gx * gx
            m[1] += weight * gx * gy
            m[2] += weight * gx * gr
            m[3] += weight * gy * gy
            m[4] += weight * gy * gr
            m[5] += weight * gr * gr
            m[6] += gx * rest
            m[7] += gy * rest
            m[8] += gr * rest


@njit(cache=True, nogil=True, error_model="numpy")
def fit_discs(image, dark, contrast, edge, usual, held, sweeps, disc, cover):  # type: ignore[no-untyped-def]
    """Fit discs to a frame by least squares.

    Args:
        image: (H, W) uint8.
        dark: (H, W) grey levels without light.
        contrast: (H, W) grey levels of full light over dark ones.
        edge: Half-width of a disc's edge, px.
        usual: (P,) radii at rest, px.
        held: (P,) standard deviation with which a pin is held to where it starts, px; inf for not
            at all. So a pin that is not seen stays.
        sweeps: Most sweeps over all pins.
        disc: (P, 3) x, y and radius, px, where the fit starts; set to the result.
        cover: (H, W), set to the sum of the discs.
    """
    pins = len(disc)
    cover[:] = 0.0
    start = disc.copy()
    for p in range(pins):
        _add_disc(disc[p, 0], disc[p, 1], disc[p, 2], edge, 1.0, cover)
    m = np.empty(9)
    moved = np.full(pins, np.inf)
    for _ in range(sweeps):
        largest = 0.0
        for p in range(pins):
            if moved[p] < STILL:
                continue
            x, y, r = disc[p, 0], disc[p, 1], disc[p, 2]
            _normal_equations(image, dark, contrast, cover, x, y, r, edge, m)
            hold = 1.0 / held[p] ** 2 + 1e-9
            loose = 1.0 / (LOOSE * usual[p]) ** 2
            xx, yy, rr = m[0] + hold, m[3] + hold, m[5] + loose
            bx = m[6] - hold * (x - start[p, 0])
            by = m[7] - hold * (y - start[p, 1])
            br = m[8] - loose * (r - usual[p])
            # Cholesky of the 3 x 3 matrix
            l0 = math.sqrt(xx)
            l1, l2 = m[1] / l0, m[2] / l0
            l3 = math.sqrt(max(yy - l1 * l1, 1e-12))
            l4 = (m[4] - l1 * l2) / l3
            l5 = math.sqrt(max(rr - l2 * l2 - l4 * l4, 1e-12))
            a = bx / l0
            b = (by - l1 * a) / l3
            dr = (br - l2 * a - l4 * b) / (l5 * l5)
            dy = (b - l4 * dr) / l3
            dx = (a - l1 * dy - l2 * dr) / l0
            step = math.sqrt(dx * dx + dy * dy)
            scale = min(1.0, LARGEST_STEP / (step + 1e-12))
            dr = min(max(dr, -0.3 * usual[p]), 0.3 * usual[p])
            _add_disc(x, y, r, edge, -1.0, cover)
            disc[p, 0] += scale * dx
            disc[p, 1] += scale * dy
            disc[p, 2] = min(max(r + dr, 0.4 * usual[p]), 1.9 * usual[p])
            _add_disc(disc[p, 0], disc[p, 1], disc[p, 2], edge, 1.0, cover)
            moved[p] = step + abs(disc[p, 2] - r)
            largest = max(largest, moved[p])
        if largest < STILL:
            break


Index = npt.NDArray[np.int64]

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
        radius: (N, P) radii of the discs that were fitted, px; NaN where none were.
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

    Bright blobs are matched to the layout by growth from certain pins (module ``matching``).
    Soft discs with the profile at rest are then fitted to the grey
    levels, all pins of a frame together. With ``refine=False``, or where the rest frame shows no
    soft discs, places are the blobs' centroids.

    Attributes:
        rest: (P, 2) px, the pins at rest, read-only; from the top row down.
        shape: Height and width of the frames.
        profile: The profile of pins at rest; None where positions are those of the blobs.
    """

    def __init__(self, rest_image: Images, *, refine: bool = True) -> None:
        """Find the pins at rest.

        Args:
            rest_image: (H, W) uint8 of the undeformed sensor.
            refine: Whether to fit discs wherever the rest frame is grey and its pins are soft.

        Raises:
            UserError: The frame is no (H, W) uint8 array or shows no pins.
        """
        xy, area = _find_pins(rest_image)
        self.profile = fit_profile(rest_image, xy, area) if refine else None
        rest = xy if self.profile is None else self.profile.disc[:, :2]
        self.rest: Array = np.array(rest, dtype=np.float64, order="C")
        self.rest.setflags(write=False)
        self.shape = (int(rest_image.shape[0]), int(rest_image.shape[1]))
        self._layout = _layout_of(self.rest)

    def track(self, images: npt.NDArray[Any]) -> Tracks:
        """Return the pins of (N, H, W) uint8 frames; N may be 0.

        Raises:
            UserError: The frames are no uint8 array of this shape, with the sensor's H and W.
        """
        if images.dtype != np.uint8 or images.shape[1:] != self.shape:
            raise UserError(
                f"the frames have shape {images.shape} and type {images.dtype}; pins are tracked "
                f"in gray frames (N, {self.shape[0]}, {self.shape[1]}) of uint8."
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
        pin whose disc shrinks has no light there and is not seen. Without a profile nothing can be
        fitted: xy is returned as it is, and no pin is seen.

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
    if image.ndim != 2 or image.dtype != np.uint8:
        raise UserError(
            f"the rest frame has shape {image.shape} and type {image.dtype}; pins are found in a "
            "gray frame (H, W) of uint8."
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
