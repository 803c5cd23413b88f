"""Frames of one sensor as displacements of its pins.

Raw pictures of a camera: the part that shows pins, cut out and evenly lit.

A pin is a spot that is brighter than its neighbourhood, and all pins have one size. The light
around them, the rim of the sensor and the reflections of lamps in the gel are no such spots. A
white top-hat (Serra, Image Analysis and Mathematical Morphology, 1982) separates what is smaller
than twice a pin from its ground, and pins in the shade are brought to the light of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Self, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose
from tactibench.errors import UserError
from tactibench.images import gray_frames
from tactibench.markers.tracker import Tracker

Images = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Places = npt.NDArray[np.float64]

_DIAMETERS_PX = (4, 6, 8, 11, 15, 21, 29)
"""Sizes of pins that are tried, each 1.4 times the one before: a top-hat of twice the diameter
still takes pins of half and one and a half times that size."""
_LEAST_PINS = 12
"""Fewer spots of one size are no pattern of pins: the smallest known sensor has 20."""
_CLEAR = 5.0
"""A spot is this many times as bright over its ground as neighbouring pixels usually differ: what
noise alone leaves of a top-hat reaches 4."""
_AREA = (0.35, 2.5)
"""Spots of one size, in shares of their median area: pins in the shade look smaller."""
_SLENDER = 1.8
"""A spot whose length is this many times its width is the edge of something."""
_APART = 2.2
"""A pin has two others within this many usual distances; otherwise the spot is no pin."""
_GLARE = 1.6
"""A spot this many times as bright as the pins around it is a lamp's reflection: pins beside each
other differ by 1.3 at most."""
_FAINT = 0.25
"""Share of a pin's level down to which the light around a reflection's middle belongs to the
reflection."""
_AROUND = 3.0
"""Distances between pins over which the light is averaged: a lamp's cone covers many pins, and a
reflection counts little among them."""
_MARGIN = 1.0
"""Distances between pins that stay around the outermost ones, which move by less than half of one:
they are fixed at the border."""
_PIN_LEVEL = 200.0
"""Level of a pin's middle in an evenly lit picture; brighter ones have room up to 255."""
_MOST_PX = 320
"""Longest side of the result: the pins of a sensor with 331 are still 5 px wide, and models see
less."""
_MOSTLY = 0.5
"""Share of the light in the spots of any size that those of the pins' size hold."""
_BETTER = 1.1
"""Frames are changed only where that shows so many times the pins: both ways find all of them in
pictures that were made for pins (Tac-VGNN, the simulator)."""


@dataclass(frozen=True, eq=False)
class PinView:
    """The part of raw pictures that shows pins, and how brightly it is lit.

    Attributes:
        shape: Height and width of the pictures, px.
        top: First row that is cut out.
        left: First column that is cut out.
        side: Rows and columns that are cut out.
        size: Rows and columns of the result.
        diameter_px: Approximate diameter of a pin in the raw picture.
        gain: (side, side) factor from the level over the ground to the level of the result; 0 at
            reflections and beyond the pins.
        dark: Whether pins are darker than the ground, so that pictures are inverted.
    """

    shape: tuple[int, int]
    top: int
    left: int
    side: int
    size: int
    diameter_px: int
    gain: Floats
    dark: bool = False

    def __str__(self) -> str:
        return (
            f"{self.side}x{self.side} px from row {self.top} and column {self.left} of "
            f"{self.shape[0]}x{self.shape[1]}{', dark pins' if self.dark else ''}"
        )

    def of(self, image: Images) -> Images:
        """Return the view of a raw picture: pins bright on black, (size, size) uint8.

        Args:
            image: (H, W) or (H, W, 3) uint8.

        Raises:
            UserError: The picture has another size than the picture in which the view was found.
        """
        from tactibench.images import gray, resized

        if image.shape[:2] != self.shape:
            raise UserError(
                f"a picture has {image.shape[0]}x{image.shape[1]} px, but pins were found in one "
                f"of {self.shape[0]}x{self.shape[1]}; take all with the same settings."
            )
        level = ~gray(image) if self.dark else gray(image)
        even = np.clip(np.rint(self._even(level)), 0, 255).astype(np.uint8)
        return resized(even, (self.size, self.size))

    def reflections(self, level: Images) -> npt.NDArray[np.bool_]:
        """Return where spots of a gray picture (H, W) are too bright for pins, (side, side)."""
        import cv2

        even = self._even(level)
        _, spot = cv2.connectedComponents((even > _FAINT * _PIN_LEVEL).astype(np.uint8))
        glaring = np.unique(spot[even > _GLARE * _PIN_LEVEL])
        reflection = np.isin(spot, glaring[glaring > 0]).astype(np.uint8)
        return np.asarray(cv2.dilate(reflection, np.ones((5, 5), np.uint8)), dtype=bool)

    def _even(self, level: Images) -> Floats:
        """Return the levels over the ground, (side, side), as if all pins were lit alike."""
        edge = 2 * self.diameter_px  # the top-hat needs the ground around what is cut out
        rows = slice(max(0, self.top - edge), self.top + self.side + edge)
        columns = slice(max(0, self.left - edge), self.left + self.side + edge)
        over = _over_ground(np.ascontiguousarray(level[rows, columns]), self.diameter_px)
        top, left = self.top - rows.start, self.left - columns.start
        return np.asarray(over[top : top + self.side, left : left + self.side]) * self.gain


def choose_light(images: Sequence[Images]) -> tuple[PinView | None, str]:
    """Try frames as they are and evenly lit, and take what shows more of a regular set of pins.

    Args:
        images: (H, W) or (H, W, 3) uint8 pictures of one sensor, the undeformed one first.

    Returns:
        The view of raw pictures, None where frames stay as they are; and how many pins each way
        finds, in words.
    """
    from tactibench.images import gray

    plain = _regular_pins([gray(image) for image in images])
    try:
        view = find_pin_view(images[0])
        even = _regular_pins([view.of(image) for image in images])
    except UserError:  # no spots of one size, or pictures of several sizes
        view, even = None, 0
    if even > max(_BETTER * plain, _LEAST_PINS):
        return view, f"even: {even} regular pins, {plain} in the frames as they are"
    if plain < _LEAST_PINS:
        return None, "as_is: no regular set of pins in the frames as they are, nor in even light"
    return None, f"as_is: {plain} regular pins, {even} in even light"


def _regular_pins(images: Sequence[Images]) -> int:
    """Return how many pins of the first picture lie as on a grid and are found in the others.

    Spots that do not are taken off: texture, lamps and pieces of large pins are many.
    """
    try:
        tracker = Tracker(images[0], refine=False)
    except UserError:  # none, or more than any sensor has
        return 0
    if len(tracker.rest) < _LEAST_PINS:
        return 0
    first, second = _distances(tracker.rest, 2).T
    pitch = np.median(second)
    regular = (first > pitch / _APART) & (second < pitch * _APART)
    net = 2 * int(np.count_nonzero(regular)) - len(regular)
    if net < _LEAST_PINS or len(images) == 1:
        return max(net, 0)
    return int(net * tracker.track(np.stack(images[1:])).seen.mean())


def find_pin_view(image: Images) -> PinView:
    """Find the pins of a raw picture and return the view of them.

    Pins are brighter than what is around them, or darker: then the picture is inverted.

    Args:
        image: (H, W) or (H, W, 3) uint8, preferably of the undeformed sensor.

    Raises:
        UserError: The picture shows no pattern of spots of one size.
    """
    from tactibench.images import gray

    level = gray(image)
    bright, inverted = _sized_spots(level), _sized_spots(~level)
    dark = inverted[0] > _BETTER * bright[0]
    _, diameter, xy, peak = inverted if dark else bright
    level = ~level if dark else level
    if len(xy) < _LEAST_PINS:
        raise UserError(
            f"a picture of {level.shape[0]}x{level.shape[1]} px shows {len(xy)} spots of one size; "
            f"at least {_LEAST_PINS} pins are needed. Give pictures of a sensor whose pins are "
            "brighter or darker than the ground, or say --param light=as_is."
        )
    pitch = _pitch(xy)
    pins = peak < _GLARE * _usual_peaks(xy, xy, peak)
    low = xy[pins].min(axis=0) - _MARGIN * pitch
    high = xy[pins].max(axis=0) + _MARGIN * pitch
    side = int(min(*level.shape, np.ceil((high - low).max())))
    middle = (low + high) / 2
    left, top = (
        int(np.clip(round(centre - side / 2), 0, length - side))
        for centre, length in zip(middle, level.shape[::-1], strict=True)
    )
    gain = _gain(xy[pins] - (left, top), peak[pins], side, pitch)
    view = PinView(level.shape, top, left, side, min(side, _MOST_PX), diameter, gain, dark)
    y, x = np.ogrid[:side, :side]
    centre = middle - (left, top)
    reach = np.linalg.norm(xy[pins] - middle, axis=1).max() + _MARGIN * pitch
    outside = np.hypot(x - centre[0], y - centre[1]) > reach  # the rim in the corners
    return replace(view, gain=np.where(outside | view.reflections(level), np.float32(0), gain))


def _sized_spots(level: Images) -> tuple[float, int, Places, Floats]:
    """Find the bright spots of the smallest size that shows them clearly.

    Of large pins a small size finds the corners: more, with less light. A large size finds lamps.

    Returns:
        The spots' light over the ground, their approximate diameter, places and peaks.
    """
    noise = _noise(level)
    found = [_find_spots(_over_ground(level, d), d, noise) for d in _DIAMETERS_PX]
    most = max(light for light, *_ in found)
    best = next(k for k, (light, *_) in enumerate(found) if light >= _MOSTLY * most)
    light, xy, peak = found[best]
    return light, _DIAMETERS_PX[best], xy, peak


def _over_ground(level: Images, diameter: int) -> Floats:
    """Return by how many levels a picture is brighter than the ground around spots, (H, W)."""
    import cv2

    width = 2 * diameter + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    smooth = cv2.GaussianBlur(level, (0, 0), max(0.5, diameter / 8))  # a pin is no single pixel
    over = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, kernel).astype(np.float32)
    # The opening follows the darkest noise of the ground: the median is the level without a pin.
    return np.asarray(np.maximum(over - np.float32(np.median(over)), 0), dtype=np.float32)


def _noise(level: Images) -> float:
    """Return the usual difference of neighbouring pixels of a gray picture."""
    return float(np.median(np.abs(np.diff(level.astype(np.int16), axis=1))))


def _find_spots(over: Floats, diameter: int, noise: float) -> tuple[float, Places, Floats]:
    """Find the spots of about one diameter that have neighbours.

    Args:
        over: (H, W) levels over the ground, 0 or more.
        diameter: Diameter of the spots, px.
        noise: Usual difference of neighbouring pixels, levels.

    Returns:
        Number times usual area and peak of the spots, places (P, 2) px and peaks (P,).
    """
    import cv2

    # Roots bring reflections near pins, so that the threshold falls between pins and ground.
    root = np.sqrt(over)
    scaled = (root * (255.0 / max(float(root.max()), 1.0))).astype(np.uint8)
    _, bright = cv2.threshold(scaled, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    bright[over < _CLEAR * noise + 3] = 0
    count, label, stats, centre = cv2.connectedComponentsWithStats(bright, connectivity=4)
    none = 0.0, np.empty((0, 2)), np.empty(0, np.float32)
    if count <= _LEAST_PINS:
        return none
    wide, high = stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT]
    area = stats[1:, cv2.CC_STAT_AREA].astype(np.float64)
    round_ = np.maximum(wide, high) < _SLENDER * np.minimum(wide, high) + 1
    sized = round_ & (np.sqrt(area * 4 / np.pi) > diameter / 2) & (area < (2 * diameter) ** 2)
    if sized.sum() < _LEAST_PINS:
        return none
    usual = np.median(area[sized])
    sized &= (area > _AREA[0] * usual) & (area < _AREA[1] * usual)
    labels = np.flatnonzero(sized) + 1
    xy = np.asarray(centre[labels], dtype=np.float64)
    if len(xy) < _LEAST_PINS:
        return none
    peaks = np.zeros(count, np.float32)
    np.maximum.at(peaks, label.ravel().astype(np.intp), over.ravel())
    pins = _distances(xy, 2)[:, 1] < _APART * _pitch(xy)
    # A rim that the border cuts off looks like a spot there.
    pins &= ((xy >= diameter) & (xy < np.array(over.shape[::-1]) - diameter)).all(axis=1)
    xy, peak = xy[pins], peaks[labels[pins]]
    return float(len(xy) * usual * np.median(peak)) if len(xy) else 0.0, xy, peak


def _distances(xy: Places, count: int) -> Places:
    """Return the distances of every place to its nearest others, (P, count) px."""
    from scipy.spatial import cKDTree

    distances: Places = cKDTree(xy).query(xy, k=count + 1)[0][:, 1:]
    return distances


def _pitch(xy: Places) -> float:
    """Return the usual distance of a spot to its second neighbour, px."""
    return float(np.median(_distances(xy, 2)[:, 1]))


def _usual_peaks(at: Places, xy: Places, peak: Floats) -> Floats:
    """Return the median peaks of the pins around places, (N,).

    Args:
        at: (N, 2) px, the places.
        xy: (P, 2) px, the pins.
        peak: (P,) peaks of the pins.
    """
    from scipy.spatial import cKDTree

    near = cKDTree(xy).query(at, k=min(12, len(xy)))[1]
    return np.asarray(np.median(peak[near], axis=1), dtype=np.float32)


def _gain(xy: Places, peak: Floats, side: int, pitch: float) -> Floats:
    """Return the factor that brings pins at each pixel to ``_PIN_LEVEL``, (side, side)."""
    import cv2

    coarse = 32
    places = (np.stack(np.meshgrid(*[np.arange(coarse)] * 2), axis=-1) + 0.5) * side / coarse
    usual = _usual_peaks(places.reshape(-1, 2), xy, peak).reshape(coarse, coarse)
    smooth = cv2.GaussianBlur(usual, (0, 0), max(_AROUND * pitch * coarse / side, 0.5))
    gain = cv2.resize(_PIN_LEVEL / np.maximum(smooth, 1.0), (side, side))
    return np.asarray(gain, dtype=np.float32)


Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

Made = TypeVar("Made")

_GROUND, _PINS = 0.5, 0.97
"""Quantiles of a frame's grey levels that are ground and pins; pins cover 5 to 20 % of a frame."""
_FAINTEST_LIGHT = 0.05
"""Share of the rest frame's light below which noise would be taken for pins."""
_COVER = 1.25
"""Factor by which brighter pins may cover more of a frame than at rest; beyond it a reflection is
taken for pins. Blurred pins cover more and are darker."""
_ALIKE = 0.05
"""Relative difference of light below which a frame has the light of the rest frame: pins that move
under a lens differ as much."""
_SAME_GROUND, _LEVELS = 0.05, 1.0
"""Share of its grey level, and number of levels, by which the ground may differ from what the pins'
light predicts: levels are whole numbers, and a dark ground has few."""
_SATURATED = 250
"""Grey level of pins from which they may be brighter than the camera shows."""
_DOUBTFUL = 2.5
"""Pins at rest within this many spacings of a pin that was not seen may be one pin off."""


def rest_images(frames: Sequence[Frame]) -> list[Images]:
    """Return the different rest images that the frames carry, one for each sensor instance."""
    rests = (frame.rest_image for frame in frames)
    by_array = {id(rest): rest for rest in rests if rest is not None}
    different = {(image.shape, image.tobytes()): image for image in by_array.values()}
    return list(different.values())


class BySensor(Generic[Made]):
    """One object for every sensor whose frames were seen; rest images tell sensors apart."""

    def __init__(self, make: Callable[[PinTracker], Made]) -> None:
        """Take the function ``make``, which makes the object of a sensor from its pins."""
        self._make = make
        self._made: list[tuple[Images, Made]] = []

    def number(self, frame: Frame) -> int:
        """Return the number of the frame's sensor, 0 for the first one that was seen.

        Raises:
            UserError: The frame has no rest image, its rest image shows no pins, or ``make``
                refuses the sensor.
        """
        rest = frame.rest_image
        if rest is None:
            raise UserError(
                "a frame carries no rest image, by which a sensor's pins are told from another's; "
                "record one of the untouched sensor (init_0.png)."
            )
        for number, (other, _) in enumerate(self._made):
            if other is rest or (other.shape == rest.shape and np.array_equal(other, rest)):
                return number
        self._made.append((rest, self._make(PinTracker.of([frame]))))
        return len(self._made) - 1

    def __getitem__(self, number: int) -> Made:
        """Return the object that was made for the sensor of a number."""
        return self._made[number][1]

    def rows(self, frames: Sequence[Frame]) -> dict[int, list[int]]:
        """Return the number of each sensor -> rows of its frames.

        Raises:
            UserError: A frame has no rest image, a rest image shows no pins, or ``make`` refuses a
                sensor.
        """
        numbers = [self.number(frame) for frame in frames]
        return {n: [row for row, m in enumerate(numbers) if m == n] for n in sorted(set(numbers))}


class PinTracker:
    """The pins of one sensor, tracked from their places in its rest image.

    Attributes:
        rest_image: (side, side) gray, the untouched sensor.
        tracker: The tracker of its pins.
    """

    def __init__(self, rest_image: Images) -> None:
        """Find the pins at rest.

        Args:
            rest_image: (side, side) gray, the untouched sensor.

        Raises:
            UserError: The rest image shows no pins.
        """
        self.rest_image = rest_image
        self.tracker = Tracker(rest_image)

    @classmethod
    def of(cls, frames: Sequence[Frame], otherwise: Frame | None = None) -> Self:
        """Return the tracker of the rest image that the frames carry.

        Args:
            frames: Frames of one sensor.
            otherwise: A frame that is hardly pressed, for frames without a rest image.

        Raises:
            UserError: The frames are of several sensor instances, there is neither a rest image nor
                ``otherwise``, or the image that is used shows no pins.
        """
        rests = rest_images(frames)
        if len(rests) > 1:
            raise UserError(
                f"the frames are of {len(rests)} sensor instances, but here pins are followed from "
                "one rest frame; train on one (sensor.instances=0), or train superpose, vgnn, "
                "mixture, kernel, pins, nearest or unet."
            )
        rest = rests[0] if rests else None
        if rest is None and otherwise is not None:
            rest = otherwise.image
        if rest is None:
            raise UserError(
                "the frames carry no rest image, from which the pins' places are taken; record one "
                "of the untouched sensor, or use a model without pins (unet, cnn)."
            )
        return cls(gray_frames([Frame(rest, 0.0, Pose())], max(rest.shape[:2]))[0])

    @property
    def side(self) -> int:
        """Side of the images, px."""
        return len(self.rest_image)

    @property
    def rest(self) -> Array:
        """Pins at rest, (P, 2) px."""
        return self.tracker.rest

    def images(self, frames: Sequence[Frame]) -> Images:
        """Return (N, side, side) gray images in the light of the rest image."""
        images = gray_frames(frames, self.side)
        for row, image in enumerate(images):
            images[row] = self._lit(image)
        return images

    def _lit(self, image: Images) -> Images:
        """Return an image (side, side), brought to the light of the rest image if it has another.

        It stays as it is where its light is as at rest or too faint, and where it changed in a way
        that no lamp explains.
        """
        ground, contrast, cover = _light(image)
        rest_ground, rest_contrast, rest_cover = self._light
        factor = contrast / rest_contrast
        if abs(factor - 1) < _ALIKE or factor < _FAINTEST_LIGHT:
            return image
        # A lamp acts on the ground as well; lost or blurred pins and a reflection do not.
        far = abs(ground - factor * rest_ground) > max(_SAME_GROUND * ground, _LEVELS)
        if far and ground + contrast < _SATURATED:
            return image
        if factor > 1 and cover > _COVER * rest_cover:
            return image
        lit = rest_ground + (image.astype(np.float32) - ground) / np.float32(factor)
        levels: Images = np.rint(lit).clip(0, 255).astype(np.uint8)
        return levels

    @cached_property
    def _light(self) -> tuple[float, float, float]:
        return _light(self.rest_image)

    def displacements(self, images: Images) -> Array:
        """Return (N, 2 P) displacements of the pins, x of all before y of all, px."""
        return self.track(images)[0]

    def track(self, images: Images) -> tuple[Array, Flags]:
        """Return the (N, 2 P) ``displacements``, and (N, P) whether each pin is sure.

        Where pins crowd, a tracker may be one pin off. A pin nearby then finds no place, so pins
        around a pin that was not seen are doubtful.
        """
        tracks = self.tracker.track(images)
        moved = (tracks.xy - self.rest).transpose(0, 2, 1)
        sure = np.ones(tracks.seen.shape, dtype=np.bool_)
        for row in np.flatnonzero(~tracks.seen.all(axis=1)):
            sure[row] = ~self._around[:, ~tracks.seen[row]].any(axis=1)
        return moved.reshape(len(images), 2 * len(self.rest)), sure

    def retrack(self, images: Images, moved: Array) -> tuple[Array, Flags]:
        """Return displacements (N, 2 P) px of pins near ``moved``, and (N, P) whether each is seen.

        This tells crowded pins apart that ``track`` cannot.

        Args:
            images: (N, side, side) gray, in the light of the rest image.
            moved: (N, 2 P) approximate displacements, x of all pins before y of all, px.
        """
        xy = self.rest + moved.reshape(len(images), 2, -1).transpose(0, 2, 1)
        tracks = self.tracker.refit(images, xy)
        return (tracks.xy - self.rest).transpose(0, 2, 1).reshape(moved.shape), tracks.seen

    @cached_property
    def pitch(self) -> float:
        """Median distance of a pin at rest from its nearest neighbour, px."""
        distances = self._distances.copy()
        distances[np.diag_indices(len(distances))] = np.inf
        return float(np.median(distances.min(axis=1)))

    @cached_property
    def _distances(self) -> Array:
        """The (P, P) distances between pins at rest, px."""
        return np.asarray(np.hypot(*(self.rest[:, None] - self.rest).transpose(2, 0, 1)))

    @cached_property
    def _around(self) -> Flags:
        return self._distances < _DOUBTFUL * self.pitch


def _light(image: Images) -> tuple[float, float, float]:
    """Return the ground's grey level, the pins' level above it, and the share that pins cover."""
    ranks = [int(share * (image.size - 1)) for share in (_GROUND, _PINS)]
    ground, pins = np.partition(image, ranks, axis=None)[ranks].astype(float)
    contrast = max(pins - ground, 1.0)
    return ground, contrast, float(np.mean(image > ground + contrast / 2))
