"""From points in camera coordinates to frames: the parts that do not move are computed once."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from tactibench import UserError
from tactibench_sim import optical_kernels
from tactibench_sim.camera import WHITE, Noise, Optics

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
_LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of ITU-R BT.601, by which models turn colour into grey (``tactibench.gray_frames``)."""
ROUNDING = 1 / 12
"""Variance of rounding to whole grey levels."""
_QUIET = 1e-6
"""Least noise, grey levels: an edge of no width has no slope."""


def project(optics: Optics, points: Array, lift: float = 0.0) -> tuple[Array, Array, Array]:
    """Return x, y and radius of markers in the frame, px, each of shape (...).

    A marker is seen as a disc: its radius times the transverse magnification at its place, which
    without refraction is 1 / depth.

    Args:
        optics: The camera.
        points: (..., 3) places of the markers, mm.
        lift: Added to z of the points, mm; the sum is z in the camera coordinates of ``Optics``.

    Raises:
        UserError: A marker is not inside the gel.
    """
    middle = (optics.size - 1) / 2
    axis = (middle + optics.size * optics.principal_x, middle + optics.size * optics.principal_y)
    flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    out = np.empty((3, len(flat)))
    optical_kernels.project(
        flat,
        lift,
        optics.air_mm,
        optics.window_mm,
        optics.air_mm + optics.window_mm,
        optics.window_index,
        optics.gel_index,
        optics.lens == "fisheye",
        optics.focal * optics.size,
        axis,
        math.radians(optics.roll_deg),
        optics.marker_radius_mm,
        out,
    )
    if not np.isfinite(out).all():
        raise UserError(
            f"a marker is not in the gel, which begins {optics.air_mm + optics.window_mm:g} mm "
            "from the camera; move the window towards the camera (a longer gel_length) or press "
            "less deep."
        )
    x, y, radius = out.reshape(3, *points.shape[:-1])
    return x, y, radius


class Renderer:
    """A camera whose frames depend on nothing but the given points and states of the noise.

    Points are (S, P, 3) mm. With ``lift`` mm added to their z they are in the camera coordinates of
    ``Optics``.
    """

    def __init__(self, optics: Optics, lift: float = 0.0, shares: Array | float = 1.0) -> None:
        """Compute the parts of a frame that do not move.

        Args:
            optics: The camera.
            lift: Added to z of the points to get z in the camera coordinates, mm.
            shares: (P,) radii of the markers over ``marker_radius_mm``; 1: all alike.
        """
        self.optics, self.lift, self._shares = optics, lift, shares
        tint = np.array(optics.tint)
        self._luma = _LUMA * tint if len(tint) == 3 else tint
        levels = np.array([optics.background, optics.brightness - optics.background])
        static = (glare(optics), vignetting(optics), levels, gaussian_taps(optics.blur_px))
        self._static_64 = static  # for bounds
        self._static_32 = tuple(array.astype(np.float32) for array in static)  # for frames
        self._tint = tint.astype(np.float32)

    def project(self, points: Array) -> tuple[Array, Array, Array]:
        """Return x, y and radius of the markers in the frame, px, each (S, P).

        Raises:
            UserError: A marker is not inside the gel.
        """
        x, y, radius = project(self.optics, points, self.lift)
        return x, y, radius * self._shares

    def clean(self, points: Array) -> Array:
        """Return (S, size, size) grey levels without noise or rounding.

        For output "rgb" they are the BT.601 grey, for "bw" the grey frame before the threshold.

        Raises:
            UserError: A marker is not inside the gel.
        """
        return self.clean_discs(*self.project(points))

    def clean_discs(self, x: Array, y: Array, radius: Array) -> Array:
        """Return the same as ``clean`` for discs at x, y with a radius, each (S, P) px."""
        out = np.empty((len(x), self.optics.size, self.optics.size))
        optical_kernels.clean(x, y, radius, self.optics.edge_px, *self._static_64, out)
        if len(self._luma) == 3:
            out *= self._luma.sum()
        return out

    def variance(self, clean: npt.NDArray[np.floating]) -> Array:
        """Return the variance with which each pixel tells its grey level ``clean``.

        It is the variance of what a model reads over the square of its slope (``pixels``): both
        are smaller where noise is clipped at 0 or 255. For output "rgb", three channels of
        independent noise are weighted and rounded again. For "bw" it is that of the grey frame, so
        that a bound from it holds for the black-and-white frame, which holds less information.
        """
        noise, total = self.optics.noise, self._luma.sum()
        weights = _LUMA if len(self._luma) == 3 else np.ones(1)
        slope, variance = np.zeros(np.shape(clean)), np.zeros(np.shape(clean))
        for weight, luma in zip(weights, self._luma, strict=True):
            channel_slope, channel_variance = pixels(noise, luma / weight / total * clean)
            slope += luma / total * channel_slope
            variance += weight**2 * channel_variance
        return (variance + (ROUNDING if len(weights) == 3 else 0.0)) / slope**2

    def frames(self, points: Array, states: npt.NDArray[np.uint64] | None = None) -> Images:
        """Return (S, size, size) or (S, size, size, 3) uint8 frames.

        Args:
            points: (S, P, 3) mm.
            states: (S, 4) states of the noise; None: no noise.

        Raises:
            UserError: A marker is not inside the gel.
        """
        return self.disc_frames(*self.project(points), states)

    def disc_frames(
        self, x: Array, y: Array, radius: Array, states: npt.NDArray[np.uint64] | None = None
    ) -> Images:
        """Return the same as ``frames`` for discs at x, y with a radius, each (S, P) px."""
        size, noise = self.optics.size, self.optics.noise
        out = np.empty((len(x), size, size, len(self._tint)), dtype=np.uint8)
        quiet = states is None or not noise.on
        shot, read = (0.0, 0.0) if quiet else (noise.shot, noise.read)
        # The loops advance the states; the caller's stay as they are.
        advancing = np.zeros((len(x), 4), dtype=np.uint64) if states is None else states.copy()
        optical_kernels.frames(
            x,
            y,
            radius,
            self.optics.edge_px,
            *self._static_32,
            self._tint,
            advancing,
            shot,
            read,
            normal_table(),
            out,
        )
        if self.optics.output == "rgb":
            return out
        grey = out[..., 0]
        return self._threshold(grey) if self.optics.output == "bw" else grey

    def _threshold(self, grey: Images) -> Images:
        import cv2

        side = 2 * round((self.optics.threshold_side * self.optics.size - 1) / 2) + 1
        method = cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY
        for image in grey:
            image[...] = cv2.adaptiveThreshold(
                image, 255, *method, max(3, side), -self.optics.threshold_grey
            )
        return grey


def pixels(noise: Noise, clean: npt.NDArray[np.floating]) -> tuple[Array, Array]:
    """Return slope and variance of 8-bit pixels: of Gaussians, clipped to 0..255 and rounded.

    The moments of a clipped Gaussian have closed forms. Rounding adds 1/12 to the variance where
    nothing is clipped; beside 0 and 255 it adds a term with the density there (Euler and
    Maclaurin's sum over grey levels). Noise of read >= 0.7 gives the exact variance within 1.2 %.

    Args:
        noise: The noise.
        clean: (...) grey levels without noise, 0 to 255.

    Returns:
        Growth of the mean of a pixel per grey level, and the variance of a pixel, each (...).
    """
    grey = np.clip(np.asarray(clean, dtype=np.float64), 0.0, WHITE)
    square = noise.shot * grey + noise.read**2 if noise.on else np.zeros(grey.shape)
    sigma = np.sqrt(np.maximum(square, _QUIET**2))
    below, above = -grey / sigma, (WHITE - grey) / sigma
    low, high = (np.exp(-(t**2) / 2) / (sigma * math.sqrt(2 * np.pi)) for t in (below, above))
    inside, over = ndtr(above) - ndtr(below), ndtr(-above)
    mean = WHITE * over + grey * inside + sigma**2 * (low - high)
    second = WHITE**2 * over + (grey**2 + sigma**2) * inside
    second += sigma**2 * (grey * low - (grey + WHITE) * high)
    rounded = ROUNDING * (inside + mean * low + (WHITE - mean) * high)
    return inside, second - mean**2 + rounded


def vignetting(optics: Optics) -> Array:
    """Return the (H, W) factor on the light: 1 - v (1 - cos^4 a), a the angle in air of a ray."""
    distance = _polar(optics)[0] / optics.focal
    if optics.lens == "pinhole":
        cosine = 1 / np.sqrt(1 + distance**2)
    else:
        cosine = np.cos(np.minimum(distance, np.pi / 2))
    return 1 - optics.vignetting * (1 - cosine**4)


def glare(optics: Optics) -> Array:
    """Return the (H, W) white light of the LEDs' reflections: arcs that taper towards their ends.

    With ``glare_scatter`` every arc has its own length, thickness, radius and place, and swells
    where its LED is; all are drawn from ``glare_seed``.
    """
    if not optics.glare or not optics.leds:
        return np.zeros((optics.size, optics.size))
    distance, azimuth = _polar(optics)
    pitch = 2 * np.pi / optics.leds
    azimuth = azimuth - np.radians(optics.glare_start_deg)
    length, width = np.radians(optics.glare_arc_deg), optics.glare_width
    if not optics.glare_scatter:
        along = (azimuth + pitch / 2) % pitch - pitch / 2
        return _arc(optics, distance, along, length, width)
    rng = np.random.default_rng(optics.glare_seed)
    out = np.zeros((optics.size, optics.size))
    for led in range(optics.leds):
        longer, thicker, farther, turned = optics.glare_scatter * rng.uniform(-1.0, 1.0, 4)
        bump, where = optics.glare_scatter * rng.uniform(0.0, 1.0), rng.uniform(-0.3, 0.3)
        along = azimuth - led * pitch - turned * length / 4
        along = (along + np.pi) % (2 * np.pi) - np.pi
        arc_length = length * 2**longer
        swell = 1 + bump * np.exp(-(((along / arc_length - where) / 0.05) ** 2))
        away = distance - farther * width / 2
        out = np.maximum(out, _arc(optics, away, along, arc_length, width * 2**thicker * swell))
    return out


def _arc(
    optics: Optics, distance: Array, along: Array, length: float, width: float | Array
) -> Array:
    """Return the (H, W) white light of arcs that begin and end at half their length, rad."""
    taper = 1 - (2 * along / length) ** 2
    beside = abs(distance - optics.glare_radius) - width / 2 * taper
    edge = optics.edge_px / optics.size
    ramp = np.clip((edge - beside) / (2 * edge), 0, 1) * (taper > 0)
    out: Array = optics.glare * ramp**2 * (3 - 2 * ramp)
    return out


def gaussian_taps(sigma: float) -> Array:
    """Return the weights of a Gaussian of sigma px, cut at 4 sigma, sum 1; [1] for sigma 0."""
    steps = np.arange(-int(np.ceil(4 * sigma)), int(np.ceil(4 * sigma)) + 1)
    weights = np.exp(-(steps**2) / (2 * sigma**2)) if sigma else np.ones(1)
    out: Array = weights / weights.sum()
    return out


def _polar(optics: Optics) -> tuple[Array, Array]:
    """Return distance from the principal point, sides, and azimuth, rad, of every pixel."""
    steps = (np.arange(optics.size) - (optics.size - 1) / 2) / optics.size
    x, y = np.meshgrid(steps - optics.principal_x, steps - optics.principal_y)
    return np.hypot(x, y), np.arctan2(y, x) - np.radians(optics.roll_deg)


def streams(seed: np.random.SeedSequence, first: int, count: int) -> npt.NDArray[np.uint64]:
    """Return (count, 4) SFC64 states for the presses ``first``, ``first + 1``, ...

    a and b come from the seed, c is a bijection (splitmix64; Steele et al., OOPSLA 2014) of the
    seed's third word plus the press number, so that no two presses of a seed share a state; the
    kernel then stirs twelve rounds, as numpy's SFC64 does on seeding.
    """
    key = seed.generate_state(3, np.uint64)
    state = np.empty((count, 4), dtype=np.uint64)
    state[:, :2], state[:, 3] = key[:2], 1
    mixed = key[2] + np.arange(first, first + count, dtype=np.uint64) * np.uint64(_GOLDEN)
    for shift, factor in _MIX:
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    state[:, 2] = mixed ^ (mixed >> np.uint64(31))
    return state


_GOLDEN = 0x9E3779B97F4A7C15
_MIX = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))


@cache
def normal_table() -> npt.NDArray[np.float32]:
    """Return 65,536 standard normal values, equally likely: a 16-bit word picks one.

    Entry k is the mean of the normal distribution between its quantiles k and k + 1 of 65,536,
    scaled to variance 1 (by 7e-7); excess kurtosis -2e-4, largest value 4.4.
    """
    from scipy.special import ndtri

    edges = ndtri(np.arange(65_537) / 65_536)
    density = np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi)
    values = (density[:-1] - density[1:]) * 65_536
    values = (values - values[::-1]) / 2
    table: npt.NDArray[np.float32] = (values / values.std()).astype(np.float32)
    table.setflags(write=False)
    return table
