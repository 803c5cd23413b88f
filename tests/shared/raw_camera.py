"""Pictures as a camera gives them before anybody crops or evens them: 640x480, with all its faults.

The pins of a frame are enlarged and laid on a ground that is brighter on one side, inside a bright
rim, under lamps that mirror themselves in the gel.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Images = npt.NDArray[np.uint8]

HEIGHT, WIDTH = 480, 640
SIDE, LEFT, TOP = 420, 130, 25
_LAMPS = 6


def raw_frame(image: Images, rng: np.random.Generator, *, colour: bool = True) -> Images:
    """Return a picture (480, 640, 3) or (480, 640) uint8 of a gray frame (S, S) of pins."""
    import cv2

    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    middle = (LEFT + SIDE / 2, TOP + SIDE / 2)
    radius = np.hypot(x - middle[0], y - middle[1])
    inside = radius < 0.53 * SIDE
    side_light = 0.55 + 0.45 * (x - middle[0] + y - middle[1]) / SIDE
    light = np.where(inside, 55.0 + 70.0 * side_light, 25.0)
    pins = np.zeros((HEIGHT, WIDTH))
    pins[TOP : TOP + SIDE, LEFT : LEFT + SIDE] = cv2.resize(
        image, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC
    )
    light += np.where(inside, pins * (0.25 + 0.2 * side_light), 0.0)
    light[(radius >= 0.53 * SIDE) & (radius < 0.57 * SIDE)] = 220.0
    for angle in np.arange(_LAMPS) * 2 * np.pi / _LAMPS + 0.26:
        lamp = np.hypot(
            x - middle[0] - 0.25 * SIDE * np.cos(angle), y - middle[1] - 0.25 * SIDE * np.sin(angle)
        )
        light += 260.0 * np.exp(-0.5 * (lamp / 4.0) ** 2)
    light = cv2.GaussianBlur(light, (0, 0), 1.0) + rng.normal(0.0, 2.0, light.shape)
    tints = (1.0, 0.95, 0.85) if colour else (1.0,)
    raw = np.stack([np.clip(np.rint(light * tint), 0, 255) for tint in tints], axis=2)
    return raw.astype(np.uint8) if colour else raw[..., 0].astype(np.uint8)
