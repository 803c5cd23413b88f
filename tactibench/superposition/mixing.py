"""Contact mixing: frames of several contacts made from single presses, for a training set.

The displacements of single presses are added, every contact at its equivalent (``neighbours``), and
the pins are drawn at the resulting places. Nearest prior art: HapDefX (2019), whose transfer
network saw real contacts only one at a time.

The picture of a sensor's pins, learned from frames, and frames drawn with moved pins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, Pose
from tactibench.errors import UserError
from tactibench.markers import AlignedPins, AlignedSensors
from tactibench.superposition.field import (
    FEWEST,
    Field,
    FieldFamily,
    contact_array,
    drag_clue,
    single_press_rows,
)
from tactibench.superposition.neighbours import NeighbourLaw, nominal_law

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

_STEP_PX = 0.1
"""Width of the bins of distance."""
_SIZES = 12
"""Number of bins of size, which are equally filled."""
_WINDOW_PX = 1.5
"""Standard deviation of the window in which the size of a pin is measured."""
_FRAMES = 200
"""Frames from which the picture is learned, spread evenly over all."""
_CLEAR = 0.6
"""A pixel farther from every pin than this share of the pins' spacing shows the background."""
_SMOOTH_PX = 4.0
"""Under pins that never move, the background is the mean of pixels around, weighted by a Gaussian
of this standard deviation."""
_WHITE = 255
"""Largest grey level."""


@dataclass(frozen=True, eq=False)
class PinPicture:
    """A picture of the background and of pins of several sizes.

    Attributes:
        background: (H, W) grey levels.
        light: (Z, B) grey levels of a pin over the background, by size and distance.
        sizes: (Z,) sizes as ``measure`` returns them, rising.
        noise: (2,): the variance of a pixel is noise[0] + noise[1] * grey.
        reach: Half the width of a pin's window, px.
    """

    background: Array
    light: Array
    sizes: Array
    noise: Array
    reach: int

    @classmethod
    def learn(cls, images: Images, pins: Array) -> Self:
        """Learn the picture from frames, of which a few hundred are enough.

        Args:
            images: (N, H, W) gray frames.
            pins: (N, P, 2) px, the places of their pins.
        """
        some = np.unique(np.linspace(0, len(images) - 1, min(_FRAMES, len(images))).astype(int))
        images, pins = images[some], pins[some]
        apart = _nearest(pins)
        reach = max(2, int(np.ceil(0.5 * np.median(apart))))
        background = _background(images, pins, _CLEAR * float(np.median(apart)))
        empty = cls(background, np.zeros((1, 1)), np.ones(1), np.zeros(2), reach)
        size = empty.measure(images, pins)
        light, distance, inside = empty._windows(images - background, pins)
        free = apart > 1.7 * reach
        bins = int(reach / _STEP_PX) + 2
        groups = np.array_split(np.argsort(size[free]), _SIZES)
        groups = [group for group in groups if len(group)]
        near, value, counts = distance[free], light[free], inside[free]
        table = [
            _by_distance(near[group][counts[group]], value[group][counts[group]], bins)
            for group in groups
        ]
        sizes = np.array([size[free][group].mean() for group in groups])
        drawn = cls(background, np.stack(table), sizes, np.zeros(2), reach)
        noise = _noise(images, drawn._clean(pins, size))
        return cls(background, drawn.light, sizes, noise, reach)

    def measure(self, images: Images, pins: Array) -> Array:
        """Return the size of every pin, (N, P): its light in a Gaussian window, grey x px^2.

        Args:
            images: (N, H, W) gray frames.
            pins: (N, P, 2) px, the places of their pins.
        """
        out = np.empty(pins.shape[:2])
        for k, (image, xy) in enumerate(zip(images, pins, strict=True)):
            light, distance, inside = self._windows((image - self.background)[None], xy[None])
            window = np.exp(-0.5 * (distance / _WINDOW_PX) ** 2) * inside
            out[k] = (light * window).sum(axis=(-1, -2))[0]
        return out

    def draw(self, pins: Array, sizes: Array, rng: np.random.Generator) -> Images:
        """Return frames of pins, with noise, (N, H, W) uint8.

        Args:
            pins: (N, P, 2) px, the places of the pins.
            sizes: (N, P) sizes of the pins, as ``measure`` returns them.
            rng: Random numbers of the noise.
        """
        clean = self._clean(pins, sizes)
        spread = np.sqrt(np.maximum(self.noise[0] + self.noise[1] * clean, 0.0))
        noisy = clean + spread * rng.standard_normal(clean.shape, dtype=np.float32)
        frames: Images = np.rint(noisy).clip(0, _WHITE).astype(np.uint8)
        return frames

    def _clean(self, pins: Array, sizes: Array) -> npt.NDArray[np.float32]:
        height, width = self.background.shape
        out = np.empty((len(pins), height, width), dtype=np.float32)
        for k in range(len(pins)):
            row, column, distance, inside = self._cells(pins[k])
            light = (self._profile(distance, sizes[k, :, None, None]) * inside).ravel()
            cell = (row * width + column).ravel()
            drawn = np.bincount(cell, light, minlength=height * width).reshape(height, width)
            out[k] = self.background + drawn
        return out

    def _profile(self, distance: Array, sizes: Array) -> Array:
        """Return the light of pins by distance and size, interpolated between bins."""
        place = (distance / _STEP_PX - 0.5).clip(0, self.light.shape[1] - 1.001)
        size = np.interp(sizes, self.sizes, np.arange(len(self.sizes), dtype=np.float64))
        size = size.clip(0, max(len(self.sizes) - 1.001, 0.0))
        i, j = size.astype(np.intp), place.astype(np.intp)
        u, v = size - i, place - j
        table = self.light
        k = np.minimum(i + 1, len(table) - 1)
        near = (1 - u) * table[i, j] + u * table[k, j]
        far = (1 - u) * table[i, j + 1] + u * table[k, j + 1]
        value: Array = (1 - v) * near + v * far
        return value

    def _windows(self, images: Array, pins: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Return the windows of pins, (N, P, side, side).

        Returns:
            Light of every pixel, its distance from the pin, px, and whether it counts.
        """
        row, column, distance, inside = self._cells(pins)
        frame = np.arange(len(images))[:, None, None, None]
        return images[frame, row, column], distance, inside

    def _cells(
        self, pins: Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Array, npt.NDArray[np.bool_]]:
        """Return the pixels around pins (..., 2) px, (..., side, side).

        Returns:
            Row and column of every pixel, clipped to the frame, its distance from the pin, px, and
            whether it counts: it is in the frame and near enough.
        """
        height, width = self.background.shape
        steps = np.arange(-self.reach, self.reach + 1)
        middle = np.rint(pins).astype(np.intp)
        row = middle[..., 1, None, None] + steps[:, None] + 0 * steps
        column = middle[..., 0, None, None] + 0 * steps[:, None] + steps
        distance = np.hypot(column - pins[..., 0, None, None], row - pins[..., 1, None, None])
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        inside &= distance < self.reach
        return row.clip(0, height - 1), column.clip(0, width - 1), distance, inside


def _background(images: Images, pins: Array, clear: float) -> Array:
    """Return the mean level of every pixel over the frames in which no pin is near it, (H, W).

    Args:
        images: (N, H, W) gray frames.
        pins: (N, P, 2) px, the places of their pins.
        clear: Distance from every pin beyond which a pixel shows the background, px.
    """
    import cv2

    total, count = np.zeros(images.shape[1:]), np.zeros(images.shape[1:])
    for image, xy in zip(images, pins, strict=True):
        covered = np.full(image.shape, 255, dtype=np.uint8)
        inside = (xy >= 0).all(axis=1) & (xy < image.shape[::-1]).all(axis=1)
        column, row = np.rint(xy[inside]).astype(int).T
        covered[row.clip(max=image.shape[0] - 1), column.clip(max=image.shape[1] - 1)] = 0
        free = cv2.distanceTransform(covered, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) > clear
        total += image * free
        count += free
    side = (0, 0)
    around = cv2.GaussianBlur(total, side, _SMOOTH_PX), cv2.GaussianBlur(count, side, _SMOOTH_PX)
    filled = around[0] / np.maximum(around[1], 1e-9)
    level: Array = np.where(count > 0.2 * len(images), total / np.maximum(count, 1), filled)
    return level


def _nearest(pins: Array) -> Array:
    """Return the distance of every pin to its nearest neighbour, (N, P) px."""
    from scipy.spatial import cKDTree

    return np.stack([cKDTree(places).query(places, k=2)[0][:, 1] for places in pins])


def _by_distance(distance: Array, value: Array, bins: int) -> Array:
    """Return the mean value by distance, (bins,).

    Empty bins are interpolated between filled ones, and the last bin is 0.
    """
    place = np.minimum((distance / _STEP_PX).astype(int), bins - 1)
    count = np.bincount(place, minlength=bins)
    total = np.bincount(place, value, minlength=bins)
    filled = np.flatnonzero(count)
    profile = np.interp(np.arange(bins), filled, total[filled] / count[filled])
    profile[-1] = 0.0
    return profile


def _noise(images: Images, clean: npt.NDArray[np.float32]) -> Array:
    """Return offset and slope of the noise's variance by grey level, (2,).

    They are fitted to robust variances of the residuals in eight equal groups of grey levels.

    Args:
        images: (N, H, W) gray frames.
        clean: (N, H, W) the same frames, drawn without noise.
    """
    left = (images - clean).ravel()
    grey = clean.ravel()
    some = slice(None, None, max(1, len(left) // 400_000))
    order = np.argsort(grey[some])
    groups = [part for part in np.array_split(order, 8) if len(part)]
    level = np.array([grey[some][part].mean() for part in groups])
    spread = np.array([_variance(left[some][part]) for part in groups])
    slope, floor = np.polyfit(level, spread, 1) if len(groups) > 1 else (0.0, spread[0])
    return np.array([max(floor, 0.0), max(slope, 0.0)])


def _variance(values: npt.NDArray[np.floating]) -> float:
    """Return the variance of values within four robust standard deviations of the median.

    A median deviation alone would jump from one whole grey level to the next.
    """
    off = np.abs(values - np.median(values))
    inside = values[off <= 4 * 1.4826 * max(float(np.median(off)), 0.5)]
    return float(np.var(inside))


MOST = 3
"""Most contacts of a mixed frame: it has 2 or this many, equally often."""
CLOSEST_MM = 5.5
"""Smallest distance of two contacts: below it the tips of radius 3 mm would meet in the gel."""
MISFIT = 0.3
"""Largest random error, as a share of the fields that it is made of. It gives displacements that
are off by a median of 0.18 px rms of 1.5, as sums of fields are on the nominal mechanics."""
_GHOSTS = 5
"""Number of fields of random places whose sum stands for the misfit."""
_RIDGE = 1e-3
"""px^2 / mm^2 that is added to the squared length of a motion, which is 0 beyond the field's
edge."""
_BLOCK = 500
"""Frames whose contacts are drawn at once, to bound the memory."""


def mix(
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    count: int,
    rng: np.random.Generator,
    law: NeighbourLaw | None = None,
    misfit: float = 0.0,
) -> tuple[list[Frame], list[Contacts]]:
    """Return ``count`` frames with two or three contacts, and their truth.

    Only frames with one contact are used; places and depths are drawn over their range.

    Args:
        frames: Frames with their rest image.
        truth: True answers to the frames.
        count: Number of new frames.
        rng: Random numbers of everything that is drawn.
        law: Law of how contacts act on each other; None for that of the nominal dome, with friction
            as the fields show it.
        misfit: Largest smooth random error of the displacements, such as ``MISFIT``; 0 for none.

    Raises:
        UserError: There are fewer than twenty single presses, or fewer on every sensor; no frame
            has a rest image; the answers are plate poses; or the presses cover too small a range.
    """
    rows = single_press_rows(truth)
    if len(rows) < FEWEST:
        raise UserError(
            f"contact mixing needs at least {FEWEST} single presses and found {len(rows)}; "
            "raise the training count, or leave mixing out."
        )
    presses = [frames[int(row)] for row in rows]
    single = contact_array([truth[int(row)] for row in rows])[:, 0]
    low, high = single.min(axis=0), single.max(axis=0)
    sensors = _learn_sensors(presses, single)
    mixed: list[Frame] = []
    mixed_truth: list[Contacts] = []
    for number, sensor in enumerate(sensors):
        total_frames, field = len(range(number, count, len(sensors))), sensor.field()
        own_law = law or nominal_law(drag_clue(field, len(sensor.pins.rest)))
        for start in range(0, total_frames, _BLOCK):
            for contacts in _draw_contacts(min(_BLOCK, total_frames - start), low, high, rng):
                equivalents = own_law.equivalents(contacts)
                total = _add_fields(field, equivalents, rng)
                if misfit:
                    total += _unexplained(field, equivalents, misfit, low, high, rng)
                mixed += sensor.draw(total, rng)
                mixed_truth += [Contacts.truth(each[:, :2], each[:, 2]) for each in contacts]
    order = rng.permutation(count)  # so that any part of the frames is like all of them
    return [mixed[k] for k in order], [mixed_truth[k] for k in order]


@dataclass(frozen=True, eq=False)
class _Sensor:
    """Picture and field of one sensor, with P pins of the layout and P' of its own.

    Attributes:
        pins: Its pins on the layout.
        picture: Picture of its pins.
        sizes: (P',) sizes of its pins at rest.
        family: Fields of (3 P,) displacements on the layout, px, and growth of the pins.
        contacts: (N, 3) mm, its presses.
        values: (N, 3 P) displacements and growth of its presses.
    """

    pins: AlignedPins
    picture: PinPicture
    sizes: Array
    family: FieldFamily
    contacts: Array
    values: Array

    def field(self) -> Field:
        """Return the field of one contact; it is not stored, as many would not fit into memory.

        What is not known of the sensor is taken as its expectation. The way in which presses vary
        stays.
        """
        clues = self.pins.layout_clues
        field = self.family.of_sensor(clues, self.contacts, self.values)
        of_presses = np.eye(field.ways)[:, len(self.family.covariance) :]
        return field.turned(np.zeros(field.ways), of_presses)

    def draw(self, field: Array, rng: np.random.Generator) -> list[Frame]:
        """Return the frames of fields (N, 3 P)."""
        moved, growth = np.split(field, [2 * field.shape[1] // 3], axis=1)
        sizes = self.sizes * np.maximum(1 + self.pins.in_own_order(growth), 0.1)
        drawn = self.picture.draw(self.pins.place(moved), sizes, rng)
        return [Frame(image, 0.0, Pose(), self.pins.pins.rest_image) for image in drawn]


def _learn_sensors(frames: Sequence[Frame], contacts: Array) -> list[_Sensor]:
    """Return the sensors that have enough frames.

    Their fields are learned together, on the layout of the first sensor.

    Args:
        frames: N frames of single presses.
        contacts: (N, 3) x, y and depth of the presses, mm.

    Raises:
        UserError: No sensor has enough frames, no frame has a rest image, or the pins of a sensor
            are not those of the layout.
    """
    by_sensor = AlignedSensors.of(frames)
    values = np.empty((len(frames), 3 * len(by_sensor.first.rest)))
    numbers = np.empty(len(frames), dtype=np.intp)
    looks: list[tuple[PinPicture, Array]] = []
    by_number = by_sensor.rows(frames)
    if max(map(len, by_number.values())) < FEWEST:
        raise UserError(
            f"contact mixing needs {FEWEST} single presses on a sensor and found {len(frames)} on "
            f"{len(by_number)} sensors; raise the training count, or leave mixing out."
        )
    all_pins = [by_sensor[number] for number in by_number]
    for number, rows in enumerate(by_number.values()):
        pins = all_pins[number]
        images = pins.pins.images([frames[row] for row in rows])
        moved, _ = pins.track(images)
        places = pins.place(moved)
        picture = PinPicture.learn(images, places)
        sizes = picture.measure(images, places)
        resting = _resting_size(sizes, np.hypot(*(places - pins.pins.rest).transpose(2, 0, 1)))
        looks.append((picture, resting))
        growth = pins.in_layout_order(sizes / resting - 1)
        values[rows], numbers[rows] = np.concatenate([moved, growth], axis=1), number
    clues = np.array([pins.layout_clues for pins in all_pins])
    family = FieldFamily.learn(contacts, values, numbers, clues, len(by_sensor.first.rest))
    return [
        _Sensor(all_pins[n], *looks[n], family, contacts[rows], values[rows])
        for n, rows in enumerate(by_number.values())
        if len(rows) >= FEWEST
    ]


def _add_fields(field: Field, equivalents: Array, rng: np.random.Generator) -> Array:
    """Return the sums of the fields of (S, K, 3) contacts, (S, Q); each press has its own numbers.

    Args:
        field: Field of one contact, whose ways are those in which presses vary.
        equivalents: (S, K, 3) mm.
        rng: Random numbers of the presses.
    """
    parts = field.slopes(equivalents)[:, :, 0].sum(axis=1)
    numbers = rng.standard_normal((len(parts), field.ways))
    total: Array = parts[:, 0] + np.einsum("sv,svq->sq", numbers, parts[:, 1:])
    return total


def _unexplained(
    field: Field,
    equivalents: Array,
    misfit: float,
    low: Array,
    high: Array,
    rng: np.random.Generator,
) -> Array:
    """Return smooth random errors of a sum of fields, (S, 3 P).

    Contacts act on each other in ways that no equivalents describe. A network that never sees such
    errors takes the smallest bump for one more contact. Equivalents explain as much as they can, so
    the errors are orthogonal to every motion of the equivalents.

    Args:
        field: Field of one contact.
        equivalents: (S, K, 3) mm.
        misfit: Largest error, as a share of the fields that it is made of.
        low: (3,) mm, smallest x, y and depth of the presses.
        high: (3,) mm, largest x, y and depth of the presses.
        rng: Random numbers.
    """
    count = len(equivalents)
    ghosts = rng.uniform(low, high, (count, _GHOSTS, 3))
    strength = rng.uniform(0, misfit, (count, 1, 1))
    pressed = equivalents[..., 2].sum(axis=1) / high[2]
    share = strength * rng.standard_normal((count, _GHOSTS, 1)) * pressed[:, None, None]
    errors: Array = (share * field(ghosts)).sum(axis=1)
    motions = field.slopes(equivalents)[:, :, 1:, 0].reshape(count, -1, errors.shape[1])
    moved = slice(0, 2 * errors.shape[1] // 3)  # without the pins' growth, which has no length
    normal = motions[..., moved] @ motions[..., moved].transpose(0, 2, 1)
    along = np.linalg.solve(
        normal + _RIDGE * np.eye(len(normal[0])), motions[..., moved] @ errors[:, moved, None]
    )
    return errors - (motions.transpose(0, 2, 1) @ along)[..., 0]


def _resting_size(size: Array, distance: Array) -> Array:
    """Return the median size of every pin in the tenth of the frames in which it moves least.

    Args:
        size: (N, P) sizes.
        distance: (N, P) displacements, px.
    """
    least = np.argsort(distance, axis=0)[: max(1, len(distance) // 10)]
    return np.median(np.take_along_axis(size, least, axis=0), axis=0)


def _draw_contacts(
    count: int, low: Array, high: Array, rng: np.random.Generator
) -> list[npt.NDArray[np.float64]]:
    """Return contacts in the box low..high, (S, 2, 3) and (S', MOST, 3), S + S' = count.

    Contacts of one frame are at least CLOSEST_MM apart.

    Raises:
        UserError: The box is too small for such contacts.
    """
    crowds = int((rng.random(count) < 0.5).sum())
    groups = [(count - crowds, 2), (crowds, MOST)]
    return [_draw_apart(many, each, low, high, rng) for many, each in groups if many]


def _draw_apart(count: int, each: int, low: Array, high: Array, rng: np.random.Generator) -> Array:
    accepted: list[Array] = []
    missing = count
    for _ in range(200):
        tried = rng.uniform(low, high, (4 * missing + 8, each, 3))
        gaps = [
            np.hypot(*(tried[:, i, :2] - tried[:, j, :2]).T) for i in range(each) for j in range(i)
        ]
        accepted.append(tried[np.min(gaps, axis=0) >= CLOSEST_MM][:missing])
        missing -= len(accepted[-1])
        if not missing:
            return np.concatenate(accepted)
    raise UserError(
        f"the single presses cover {high[0] - low[0]:.1f} x {high[1] - low[1]:.1f} mm, too little "
        f"for {each} contacts {CLOSEST_MM:g} mm apart; press a wider range or leave mixing out."
    )
