"""From points in camera coordinates to frames: what is fixed is computed once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactibench_sim import kernels
from tactibench_sim.lens import project
from tactibench_sim.noise import ROUNDING, normal_table
from tactibench_sim.optics import Optics
from tactibench_sim.still import gaussian_taps, glare, vignetting

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
_LUMA = np.array([0.299, 0.587, 0.114])
"""ITU-R BT.601, with which models make grey of colour (``tactibench.gray_frames``)."""


class Renderer:
    """A camera. Frames depend on the points and the noise state handed in, on nothing else.

    Points are (S, P, 3) mm in camera coordinates of ``Optics``, z being ``lift`` mm more.
    """

    def __init__(self, optics: Optics, lift: float = 0.0) -> None:
        self.optics, self.lift = optics, lift
        tint = np.array(optics.tint)
        self._luma = _LUMA * tint if len(tint) == 3 else tint
        levels = np.array([optics.background, optics.brightness - optics.background])
        parts = (glare(optics), vignetting(optics), levels, gaussian_taps(optics.blur_px))
        self._exact = parts
        self._still = tuple(part.astype(np.float32) for part in parts)
        self._tint = tint.astype(np.float32)

    def project(self, points: Array) -> tuple[Array, Array, Array]:
        """Pixel x, y and radius px, each (S, P). Raises UserError for points not in the gel."""
        return project(self.optics, points, self.lift)

    def clean(self, points: Array) -> Array:
        """(S, size, size) grey levels without noise or rounding; of "rgb" the BT.601 grey.

        For output "bw" the grey frame that is thresholded.
        """
        return self.splatted(*self.project(points))

    def splatted(self, x: Array, y: Array, radius: Array) -> Array:
        """``clean`` of discs (S, P), px."""
        out = np.empty((len(x), self.optics.size, self.optics.size))
        kernels.clean(x, y, radius, self.optics.edge_px, *self._exact, out)
        if len(self._luma) == 3:
            out *= self._luma.sum()
        return out

    def variance(self, clean: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        """Variance of the pixels of ``clean`` as a model takes them in, rounding included.

        Of "rgb": three channels of independent noise, weighted and rounded again. Of "bw": of the
        grey frame, so that a bound from it holds for the black-and-white one, which knows less.
        """
        noise = self.optics.noise
        if len(self._luma) == 1:
            return noise.variance(clean)
        white = clean / self._luma.sum()
        channels = zip(_LUMA, self._luma / _LUMA, strict=True)
        return sum((w**2 * noise.variance(t * white) for w, t in channels), ROUNDING + 0 * clean)

    def frames(self, points: Array, states: npt.NDArray[np.uint64] | None = None) -> Images:
        """(S, size, size) or (S, size, size, 3) uint8. states: (S, 4); None: no noise."""
        return self.exposed(*self.project(points), states)

    def exposed(
        self, x: Array, y: Array, radius: Array, states: npt.NDArray[np.uint64] | None = None
    ) -> Images:
        """``frames`` of discs (S, P), px."""
        size, noise = self.optics.size, self.optics.noise
        out = np.empty((len(x), size, size, len(self._tint)), dtype=np.uint8)
        quiet = states is None or not noise.on
        own = np.zeros((len(x), 4), dtype=np.uint64) if states is None else states.copy()
        kernels.frames(
            x,
            y,
            radius,
            self.optics.edge_px,
            *self._still,
            self._tint,
            own,
            *((0.0, 0.0) if quiet else (noise.shot, noise.read)),
            normal_table(),
            out,
        )
        if self.optics.output == "rgb":
            return out
        grey = out[..., 0]
        return self._thresholded(grey) if self.optics.output == "bw" else grey

    def _thresholded(self, grey: Images) -> Images:
        import cv2

        side = 2 * round((self.optics.threshold_side * self.optics.size - 1) / 2) + 1
        way = cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY
        for image in grey:
            image[...] = cv2.adaptiveThreshold(
                image, 255, *way, max(3, side), -self.optics.threshold_grey
            )
        return grey
