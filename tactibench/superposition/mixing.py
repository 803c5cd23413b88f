"""Contact mixing: frames of several contacts made from single presses, for a training set.

The displacements of single presses are added, every contact at its equivalent (``neighbours``), and
the pins are drawn at the resulting places. Nearest prior art: HapDefX (2019), whose transfer
network saw real contacts only one at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, Pose
from tactibench.errors import UserError
from tactibench.markers import AlignedPins, AlignedSensors
from tactibench.superposition.family import FieldFamily
from tactibench.superposition.field import FEWEST, Field, contact_array, single_press_rows
from tactibench.superposition.neighbours import NeighbourLaw, nominal_law
from tactibench.superposition.picture import PinPicture

Array = npt.NDArray[np.float64]

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
        law: Law of how contacts act on each other; None for that of the nominal dome.
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
    law = law or nominal_law()
    low, high = single.min(axis=0), single.max(axis=0)
    sensors = _learn_sensors(presses, single)
    mixed: list[Frame] = []
    mixed_truth: list[Contacts] = []
    for number, sensor in enumerate(sensors):
        total_frames, field = len(range(number, count, len(sensors))), sensor.field()
        for start in range(0, total_frames, _BLOCK):
            for contacts in _draw_contacts(min(_BLOCK, total_frames - start), low, high, rng):
                equivalents = law.equivalents(contacts)
                total = field(equivalents).sum(axis=1)
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
        """Return the field of one contact; it is not stored, as many would not fit into memory."""
        clues = self.pins.layout_clues
        field = self.family.of_sensor(clues, self.contacts, self.values)
        return field.turned(np.zeros(field.ways), np.zeros((field.ways, 0)))

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
    family = FieldFamily.learn(contacts, values, numbers, clues)
    return [
        _Sensor(all_pins[n], *looks[n], family, contacts[rows], values[rows])
        for n, rows in enumerate(by_number.values())
        if len(rows) >= FEWEST
    ]


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
    motions = field.slopes(equivalents)[:, :, 1:].reshape(count, -1, errors.shape[1])
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
