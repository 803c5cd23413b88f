"""From pin tips to noise-free frames: a pinhole camera inside the dome and soft-edged discs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Camera:
    """Everything between a pin tip and a noise-free pixel.

    size: frame side, px. centre_mm: height of the dome's centre above the camera; 35 mm puts it
    55 mm from the apex (a public TacTip simulation). focal: in frame sides; 1.0294 makes the
    outermost pins of the real rest frames stand 65 deg from the apex (assumed), a field of view of
    52 deg. pin_radius_mm: of the white tips; discs in the real frames are 0.43 to 0.52 mm.
    edge_px: half-width of the smooth edge (blur, assumed). background, brightness: grey levels of
    gel and tips (assumed).

    Pixel (row i, column j) has its centre at y = i, x = j; the axis meets ((size - 1) / 2) twice.
    Refraction at the lens is left out.
    """

    size: int = 128
    centre_mm: float = 35.0
    focal: float = 1.0294
    pin_radius_mm: float = 0.5
    edge_px: float = 1.0
    background: float = 16.0
    brightness: float = 208.0

    def project(self, tips: Array) -> tuple[Array, Array, Array]:
        """Pixel x, y and radius px (...) of tips (..., 3) given from the dome's centre, mm.

        The camera looks along +z, x right and y down.
        """
        scale = self.focal * self.size / (self.centre_mm + tips[..., 2])
        middle = (self.size - 1) / 2
        x, y = middle + scale * tips[..., 0], middle + scale * tips[..., 1]
        return x, y, scale * self.pin_radius_mm

    def splat(self, x: Array, y: Array, radius: Array) -> Array:
        """(S, size, size) coverage 0..1 of S frames with (S, P) discs.

        A disc's profile is a smoothstep of the distance from its rim, +-edge_px wide, sampled at
        the pixels' centres; overlapping discs add up to at most 1.
        """
        reach = radius + self.edge_px
        window = int(2 * reach.max(initial=0.0)) + 1
        pad, side = window, self.size + 2 * window
        left = np.clip(np.ceil(x - reach), -pad, self.size)
        top = np.clip(np.ceil(y - reach), -pad, self.size)
        steps = np.arange(window)
        across = ((left - x)[..., None] + steps) ** 2
        down = ((top - y)[..., None] + steps) ** 2
        distance = np.sqrt(down[..., :, None] + across[..., None, :])
        ramp = (reach[..., None, None] - distance) * (0.5 / self.edge_px)
        np.clip(ramp, 0.0, 1.0, out=ramp)
        ramp *= ramp * (3 - 2 * ramp)
        frames = np.arange(len(x))[:, None] * side
        first = ((frames + top + pad) * side + left + pad).astype(np.intp)
        place = first[..., None, None] + (steps[:, None] * side + steps)
        total = np.bincount(place.ravel(), ramp.ravel(), minlength=len(x) * side * side)
        inside = total.reshape(len(x), side, side)[:, pad:-pad, pad:-pad]
        return np.minimum(inside, 1.0)

    def render(self, tips: Array) -> Array:
        """(S, size, size) grey levels without noise of pin tips (S, P, 3) mm."""
        coverage = self.splat(*self.project(tips))
        coverage *= self.brightness - self.background
        coverage += self.background
        return coverage
