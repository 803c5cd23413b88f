"""Faults of a camera or its light: pure functions of a frame, an amount and a generator.

Images are (H, W) or (H, W, 3) uint8 and are never changed in place. The amount 0 (of ``gain``: 1)
leaves every frame as it is. The random numbers of a fault do not depend on its amount: a greater
amount loses the same pins and more, or shifts further in the same direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from tactibench.images import gray
from tactibench.markers import FAINTEST

Image = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int32]
Levels = npt.NDArray[np.float64]
Generator = np.random.Generator

MIDDLE = 0.6
"""Share of either side, around the middle, in which spots and patches have their centres."""
SPREAD = 0.8
"""Share of either side, around the middle, in which spurious blobs have their centres."""
BLOB_EDGE = 2
"""Pixels around a blob that its soft edge reaches."""
WINDOW = 8
"""Half the side of the window, px, whose dark pixels replace those of a blob."""
SMALLEST_BLOB = 0.25
"""Blobs below this share of the median area are noise."""


def blur(image: Image, sigma: float) -> Image:
    """Smooth with a Gaussian of ``sigma`` px; the frame's own noise is smoothed with it."""
    from scipy.ndimage import gaussian_filter

    if sigma == 0:
        return image
    wide = (sigma, sigma, *(0,) * (image.ndim - 2))
    return _to_levels(gaussian_filter(image.astype(np.float64), wide, mode="nearest"))


def add_noise(image: Image, deviation: float, rng: Generator) -> Image:
    """Add Gaussian noise of ``deviation`` grey levels rms to the frame's own noise."""
    return _to_levels(image + deviation * rng.standard_normal(image.shape))


def scale(image: Image, factor: float) -> Image:
    """Multiply every grey level by ``factor``, cut off at white."""
    return _to_levels(image.astype(np.float64) * factor)


def add_glare(image: Image, radius: float, rng: Generator) -> Image:
    """Add a round reflection: white up to half of ``radius`` px, falling to nothing there."""
    away = np.hypot(*_from(image, _place(rng, image, MIDDLE)))
    if radius == 0:
        return image
    light = 255 * np.clip(2 - 2 * away / radius, 0, 1)
    return _to_levels(image + _over(light, image))


def drift_gain(image: Image, amount: float, rng: Generator) -> Image:
    """Apply a gain that drifts along the frame: 1 - amount at one edge, 1 + amount at the other.

    It is linear in a direction that is drawn for each frame, and 1 in the middle.
    """
    turn = rng.uniform(0, 2 * math.pi)
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width]
    along = math.cos(turn) * (2 * x / (width - 1) - 1) + math.sin(turn) * (2 * y / (height - 1) - 1)
    most = abs(math.cos(turn)) + abs(math.sin(turn))
    return _to_levels(image * _over(1 + amount * along / most, image))


def blacken_rows(image: Image, count: float, rng: Generator) -> Image:
    """Blacken ``count`` whole rows, as dead rows of the sensor chip do."""
    rows = rng.permutation(len(image))[: round(count)]
    out = image.copy()
    out[rows] = 0
    return out


def occlude(image: Image, side: float, rng: Generator) -> Image:
    """Cover part of the view with a black square of ``side`` px."""
    down, right = _from(image, _place(rng, image, MIDDLE))
    covered = (2 * abs(down) < side) & (2 * abs(right) < side)
    out = image.copy()
    out[covered] = 0
    return out


def remove_pins(image: Image, share: float, rng: Generator) -> Image:
    """Paint over round(share x pins) pins, as if they had lost their white tip.

    Pins are the bright blobs of the frame itself.
    """
    labels, count = label_pins(image)
    lost = rng.permutation(count)[: round(share * count)] + 1
    return paint_over(image, labels, lost, rng)


def add_blobs(image: Image, count: float, rng: Generator) -> Image:
    """Add ``count`` bright discs that are no pins, as large and as bright as the frame's pins."""
    labels, pins = label_pins(image)
    places = np.array([_place(rng, image, SPREAD) for _ in range(round(count))]).reshape(-1, 2)
    if not len(places):
        return image
    area = float(np.median(np.bincount(labels.ravel())[1:])) if pins else 9.0
    bright = np.percentile(image[labels > 0], 90, axis=0) if pins else 255.0
    cover = _over(draw_discs(image.shape[:2], places, math.sqrt(area / math.pi)), image)
    return _to_levels(np.maximum(image, image + cover * (bright - image.astype(np.float64))))


def move(image: Image, right: float, down: float) -> Image:
    """Move the image: everything is seen ``right`` and ``down`` px from where it was.

    Cubic splines between the pixels; what comes into view repeats the border.
    """
    from scipy.ndimage import shift

    if right == down == 0:
        return image
    by = (down, right, *(0.0,) * (image.ndim - 2))
    return _to_levels(shift(image.astype(np.float64), by, order=3, mode="nearest"))


def rotate(image: Image, degrees: float) -> Image:
    """Rotate the image about its middle by ``degrees``, x towards y.

    Cubic splines between the pixels; what comes into view repeats the border.
    """
    from scipy.ndimage import affine_transform

    if degrees == 0:
        return image
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    back = np.eye(image.ndim)  # from where a pixel is seen to where it was, (row, column, colour)
    back[:2, :2] = [[c, -s], [s, c]]
    middle = np.array([(n - 1) / 2 for n in image.shape[:2]] + [0.0] * (image.ndim - 2))
    levels = image.astype(np.float64)
    return _to_levels(
        affine_transform(levels, back, middle - back @ middle, order=3, mode="nearest")
    )


def _shift_somewhere(image: Image, length: float, rng: Generator) -> Image:
    turn = rng.uniform(0, 2 * math.pi)
    return move(image, length * math.cos(turn), length * math.sin(turn))


def _rotate_either_way(image: Image, degrees: float, rng: Generator) -> Image:
    return rotate(image, degrees * float(rng.choice([-1.0, 1.0])))


def _to_levels(image: npt.NDArray[np.floating]) -> Image:
    """Return grey levels, rounded and cut off at 0 and 255."""
    return np.asarray(np.rint(np.clip(image, 0, 255)), dtype=np.uint8)


def _place(rng: Generator, image: Image, share: float) -> Levels:
    """Draw (row, column) px, uniform over the middle ``share`` of either side."""
    last = np.array(image.shape[:2], dtype=np.float64) - 1
    place: Levels = (0.5 + share * rng.uniform(-0.5, 0.5, 2)) * last
    return place


def _from(image: Image, place: Levels) -> tuple[Levels, Levels]:
    """Return how far every pixel lies below and to the right of a place, (H, W) px each."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in image.shape[:2])
    down, right = np.meshgrid(rows - place[0], columns - place[1], indexing="ij")
    return down, right


def _over(plane: Levels, image: Image) -> Levels:
    """Return an (H, W) plane that can be combined with every colour of an image."""
    return plane if image.ndim == 2 else plane[..., None]


def label_pins(image: Image) -> tuple[Labels, int]:
    """Return the (H, W) number of the bright blob at every pixel, 0 for none, and their count.

    Blobs are brighter than Otsu's threshold (IEEE Trans. SMC 9, 1979); their pixels are joined by
    sides. A frame whose contrast is too small to hold pins has none.
    """
    import cv2

    level = gray(image)
    if int(level.max()) - int(level.min()) < FAINTEST:
        return np.zeros(level.shape, np.int32), 0
    _, bright = cv2.threshold(level, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    _, labels = cv2.connectedComponents(bright, connectivity=4, ltype=cv2.CV_32S)
    area = np.bincount(labels.ravel())
    pins = np.flatnonzero(area[1:] >= SMALLEST_BLOB * np.median(area[1:])) + 1
    number = np.zeros(len(area), np.int32)
    number[pins] = np.arange(1, len(pins) + 1)
    return number[labels], len(pins)


def paint_over(
    image: Image, labels: Labels, which: npt.NDArray[np.intp], rng: np.random.Generator
) -> Image:
    """Return the image with blobs painted over by pixels drawn from the dark ones around each.

    The noise and the shading of the gel around a blob stay the same.

    Args:
        image: The image.
        labels: (H, W) number of the blob at every pixel, 0 for none.
        which: Numbers of the blobs to paint over.
        rng: Draws the pixels.
    """
    import cv2

    out = image.copy()
    square = np.ones((2 * BLOB_EDGE + 1, 2 * BLOB_EDGE + 1), np.uint8)
    dark = cv2.dilate((labels > 0).astype(np.uint8), square) == 0
    if not dark.any():
        dark = labels == 0
    for number in which:
        pin = labels == number
        rows, columns = np.nonzero(pin)
        window = (
            slice(max(0, rows.min() - WINDOW), rows.max() + WINDOW + 1),
            slice(max(0, columns.min() - WINDOW), columns.max() + WINDOW + 1),
        )
        blob = cv2.dilate(pin[window].astype(np.uint8), square) > 0
        blob &= (labels[window] == 0) | pin[window]
        around = dark[window] if dark[window].any() else labels[window] == 0
        out[window][blob] = rng.choice(image[window][around], int(blob.sum()))
    return out


def draw_discs(
    shape: tuple[int, ...], places: npt.NDArray[np.float64], radius: float
) -> npt.NDArray[np.float64]:
    """Return (H, W) in 0..1: discs of ``radius`` px at (row, column) places, edges a pixel wide."""
    rows, columns = (np.arange(n, dtype=np.float64) for n in shape)
    cover = np.zeros(shape)
    for row, column in places:
        away = np.hypot(rows[:, None] - row, columns[None] - column)
        np.maximum(cover, np.clip(radius + 0.5 - away, 0, 1), out=cover)
    return cover


FAULTS: Mapping[str, Callable[[Image, float, Generator], Image]] = {
    "blur": lambda image, sigma, _: blur(image, sigma),
    "noise": add_noise,
    "gain": lambda image, factor, _: scale(image, factor),
    "glare": add_glare,
    "gain-drift": drift_gain,
    "dead-rows": blacken_rows,
    "occlusion": occlude,
    "lost-pins": remove_pins,
    "spurious-blobs": add_blobs,
    "shift": _shift_somewhere,
    "rotation": _rotate_either_way,
}
"""Name of a fault in a protocol -> function of an image, an amount and a generator."""
