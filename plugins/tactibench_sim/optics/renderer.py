"""From points in camera coordinates to frames: the parts that do not move are computed once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench_sim.optics import kernels
from tactibench_sim.optics.camera import Optics
from tactibench_sim.optics.lens import project
from tactibench_sim.optics.noise import ROUNDING, normal_table

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
_LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of ITU-R BT.601, by which models turn colour into grey (``tactibench.gray_frames``)."""


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
        kernels.clean(x, y, radius, self.optics.edge_px, *self._static_64, out)
        if len(self._luma) == 3:
            out *= self._luma.sum()
        return out

    def variance(self, clean: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        """Return the variance of the pixels of ``clean`` as a model reads them, with rounding.

        For output "rgb", three channels of independent noise are weighted and rounded again. For
        "bw" it is that of the grey frame, so that a bound from it holds for the black-and-white
        frame, which holds less information.
        """
        noise = self.optics.noise
        if len(self._luma) == 1:
            return noise.variance(clean)
        white = clean / self._luma.sum()
        channels = zip(_LUMA, self._luma / _LUMA, strict=True)
        return sum((w**2 * noise.variance(t * white) for w, t in channels), ROUNDING + 0 * clean)

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
        kernels.frames(
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
