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


def raw_discs(
    pins: npt.NDArray[np.float64],
    radius: float,
    rng: np.random.Generator,
    *,
    ground: float,
    pin: float,
    surround: tuple[float, float] = (150.0, 175.0),
    lamps: int = 6,
) -> Images:
    """Return an RGB picture (480, 640, 3) of discs at pins (P, 2) px, 200 px around its middle.

    Ground and pins are 30 % brighter on one side, and the surround rises from left to right.
    """
    import cv2

    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    across, down = x - WIDTH / 2, y - HEIGHT / 2
    light = ground + (pin - ground) * discs(pins, radius, (HEIGHT, WIDTH))
    light *= 1 + 0.3 * (across + down) / 400
    outer = surround[0] + (surround[1] - surround[0]) * x / WIDTH
    light = np.where(np.hypot(across, down) < 200, light, outer)
    for angle in np.arange(lamps) * 2 * np.pi / max(lamps, 1) + 0.26:
        lamp = np.hypot(across - 100 * np.cos(angle), down - 100 * np.sin(angle))
        light += 180.0 * np.exp(-0.5 * (lamp / 4.0) ** 2)
    light = cv2.GaussianBlur(light, (0, 0), 1.0) + rng.normal(0.0, 2.0, light.shape)
    raw = np.stack([light, 0.95 * light, 0.85 * light], axis=2)
    return np.clip(np.rint(raw), 0, 255).astype(np.uint8)


def discs(
    pins: npt.NDArray[np.float64], radius: float, shape: tuple[int, int]
) -> npt.NDArray[np.float64]:
    """Return the cover (H, W) of discs at pins (P, 2) px, from 0 to 1."""
    cover = np.zeros(shape)
    wide = int(radius) + 3
    for x, y in pins:
        top, left = max(0, int(y) - wide), max(0, int(x) - wide)
        part = cover[top : int(y) + wide + 1, left : int(x) + wide + 1]
        rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
        away = np.hypot(rows + top - y, columns + left - x)
        np.maximum(part, np.clip(radius + 0.5 - away, 0, 1), out=part)
    return cover
