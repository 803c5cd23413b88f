"""What can go wrong with a camera or its light: pure functions of a frame, an amount, a generator.

Images are (H, W) or (H, W, 3) uint8 and are never changed in place. The amount 0 (of ``gain``: 1)
leaves every frame as it is. What a fault draws at random does not depend on its amount: a greater
one loses the same pins and more, shifts further in the same direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from tactibench.frames.spots import discs, pin_labels, repainted

Image = npt.NDArray[np.uint8]
Levels = npt.NDArray[np.float64]
Generator = np.random.Generator

MIDDLE = 0.6
"""Share of either side, around the middle, in which spots and patches have their centres."""
SPREAD = 0.8
"""The same of spurious blobs."""


def blurred(image: Image, sigma: float) -> Image:
    """Gaussian blur of ``sigma`` px; the frame's own noise is smoothed with it."""
    from scipy.ndimage import gaussian_filter

    if sigma == 0:
        return image
    wide = (sigma, sigma, *(0,) * (image.ndim - 2))
    return as_levels(gaussian_filter(image.astype(np.float64), wide, mode="nearest"))


def noisy(image: Image, deviation: float, rng: Generator) -> Image:
    """Gaussian noise of that many grey levels rms, beyond the frame's own."""
    return as_levels(image + deviation * rng.standard_normal(image.shape))


def scaled(image: Image, factor: float) -> Image:
    """Every grey level times ``factor``, cut off at white."""
    return as_levels(image.astype(np.float64) * factor)


def glaring(image: Image, radius: float, rng: Generator) -> Image:
    """A round reflection: white up to half of ``radius`` px, then falling to nothing there."""
    away = np.hypot(*_from(image, _place(rng, image, MIDDLE)))
    if radius == 0:
        return image
    light = 255 * np.clip(2 - 2 * away / radius, 0, 1)
    return as_levels(image + _over(light, image))


def drifted(image: Image, amount: float, rng: Generator) -> Image:
    """A gain that drifts along the frame: 1 - amount at one edge, 1 + amount at the other.

    Linear in a direction drawn for each frame; 1 in the middle.
    """
    turn = rng.uniform(0, 2 * math.pi)
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width]
    along = math.cos(turn) * (2 * x / (width - 1) - 1) + math.sin(turn) * (2 * y / (height - 1) - 1)
    most = abs(math.cos(turn)) + abs(math.sin(turn))
    return as_levels(image * _over(1 + amount * along / most, image))


def without_rows(image: Image, count: float, rng: Generator) -> Image:
    """``count`` whole rows of the sensor chip are dead: black."""
    rows = rng.permutation(len(image))[: round(count)]
    out = image.copy()
    out[rows] = 0
    return out


def occluded(image: Image, side: float, rng: Generator) -> Image:
    """A black square of ``side`` px covers part of the view."""
    down, right = _from(image, _place(rng, image, MIDDLE))
    covered = (2 * abs(down) < side) & (2 * abs(right) < side)
    out = image.copy()
    out[covered] = 0
    return out


def without_pins(image: Image, share: float, rng: Generator) -> Image:
    """round(share x pins) pins lose their white tip: they are painted over by what is around them.

    Pins are the bright blobs of the frame itself.
    """
    labels, count = pin_labels(image)
    lost = rng.permutation(count)[: round(share * count)] + 1
    return repainted(image, labels, lost, rng)


def with_blobs(image: Image, count: float, rng: Generator) -> Image:
    """``count`` bright discs that are no pins, as large and as bright as the frame's pins."""
    labels, pins = pin_labels(image)
    places = np.array([_place(rng, image, SPREAD) for _ in range(round(count))]).reshape(-1, 2)
    if not len(places):
        return image
    area = float(np.median(np.bincount(labels.ravel())[1:])) if pins else 9.0
    bright = np.percentile(image[labels > 0], 90, axis=0) if pins else 255.0
    cover = _over(discs(image.shape[:2], places, math.sqrt(area / math.pi)), image)
    return as_levels(np.maximum(image, image + cover * (bright - image.astype(np.float64))))


def shifted(image: Image, right: float, down: float) -> Image:
    """The camera moved: everything is seen ``right`` and ``down`` px from where it was.

    Cubic splines between the pixels; what comes into view repeats the border.
    """
    from scipy.ndimage import shift

    if right == down == 0:
        return image
    by = (down, right, *(0.0,) * (image.ndim - 2))
    return as_levels(shift(image.astype(np.float64), by, order=3, mode="nearest"))


def turned(image: Image, degrees: float) -> Image:
    """The camera turned about its axis: everything is seen turned by so much, x towards y.

    Cubic splines between the pixels, around the frame's middle; the border is repeated.
    """
    from scipy.ndimage import affine_transform

    if degrees == 0:
        return image
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    back = np.eye(image.ndim)  # from where a pixel is seen to where it was, (row, column, colour)
    back[:2, :2] = [[c, -s], [s, c]]
    middle = np.array([(n - 1) / 2 for n in image.shape[:2]] + [0.0] * (image.ndim - 2))
    levels = image.astype(np.float64)
    return as_levels(
        affine_transform(levels, back, middle - back @ middle, order=3, mode="nearest")
    )


def _shifted_somewhere(image: Image, length: float, rng: Generator) -> Image:
    turn = rng.uniform(0, 2 * math.pi)
    return shifted(image, length * math.cos(turn), length * math.sin(turn))


def _turned_either_way(image: Image, degrees: float, rng: Generator) -> Image:
    return turned(image, degrees * float(rng.choice([-1.0, 1.0])))


def as_levels(image: npt.NDArray[np.floating]) -> Image:
    """Grey levels, rounded and cut off at 0 and 255."""
    return np.asarray(np.rint(np.clip(image, 0, 255)), dtype=np.uint8)


def _place(rng: Generator, image: Image, share: float) -> Levels:
    """(row, column) px, uniform over the middle ``share`` of either side."""
    last = np.array(image.shape[:2], dtype=np.float64) - 1
    place: Levels = (0.5 + share * rng.uniform(-0.5, 0.5, 2)) * last
    return place


def _from(image: Image, place: Levels) -> tuple[Levels, Levels]:
    """(H, W) px down and right of a place."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in image.shape[:2])
    down, right = np.meshgrid(rows - place[0], columns - place[1], indexing="ij")
    return down, right


def _over(plane: Levels, image: Image) -> Levels:
    """(H, W) to be combined with every colour of an image."""
    return plane if image.ndim == 2 else plane[..., None]


FAULTS: Mapping[str, Callable[[Image, float, Generator], Image]] = {
    "blur": lambda image, sigma, _: blurred(image, sigma),
    "noise": noisy,
    "gain": lambda image, factor, _: scaled(image, factor),
    "glare": glaring,
    "gain-drift": drifted,
    "dead-rows": without_rows,
    "occlusion": occluded,
    "lost-pins": without_pins,
    "spurious-blobs": with_blobs,
    "shift": _shifted_somewhere,
    "rotation": _turned_either_way,
}
"""By the name that a protocol gives it: image, amount, generator -> image."""
