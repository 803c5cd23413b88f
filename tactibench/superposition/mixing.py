"""Contact mixing: frames of several contacts made from single presses, for a training set.

The displacements of single presses are added, every contact at its equivalent (``neighbours``), and
the pins are drawn where that puts them. Nearest prior art: HapDefX (2019), whose transfer network
saw real contacts one at a time only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, Pose
from tactibench.errors import UserError
from tactibench.markers import PinTracker
from tactibench.superposition.field import FEWEST, Field, contact_array, single_press_rows
from tactibench.superposition.neighbours import NeighbourLaw, nominal_law
from tactibench.superposition.picture import PinPicture

Array = npt.NDArray[np.float64]

MOST = 3
"""Contacts of a mixed frame: 2 or this many, equally often."""
CLOSEST_MM = 5.5
"""Least distance of two contacts: below it the tips of radius 3 mm would meet in the gel."""
MISFIT = 0.3
"""Most of the random errors, as a share of the fields that they are made of. It gives displacements
that are off by a median of 0.18 px rms of 1.5, as sums of fields are on the nominal mechanics."""
_GHOSTS = 5
"""Fields of places drawn at random whose sum stands for the misfit."""
_RIDGE = 1e-3
"""px^2 / mm^2 added to the squared length of a motion, which is 0 beyond the field's edge."""
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
        frames: with their rest image.
        truth: of the frames.
        count: of new frames.
        rng: all that is random comes from it.
        law: how contacts act on each other; None: that of the nominal dome.
        misfit: smooth random errors of the displacements, such as ``MISFIT``; 0: none.

    Raises:
        UserError: for fewer than twenty single presses or frames without a rest image.
    """
    rows = single_press_rows(truth)
    if len(rows) < FEWEST:
        raise UserError(
            f"contact mixing needs at least {FEWEST} single presses and found {len(rows)}; "
            "raise the training count, or leave mixing out."
        )
    presses = [frames[int(row)] for row in rows]
    pins = PinTracker.of(presses)
    images = pins.images(presses)
    single = contact_array([truth[int(row)] for row in rows])[:, 0]
    moved = pins.displacements(images)
    xy = pins.rest + moved.reshape(len(moved), 2, -1).transpose(0, 2, 1)
    picture = PinPicture.learn(images, xy)
    sizes = picture.measure(images, xy)
    resting = _resting_size(sizes, moved)
    growth = sizes / resting - 1
    field = Field.learn(single, np.concatenate([moved, growth], axis=1))
    law = law or nominal_law()

    mixed: list[Frame] = []
    mixed_truth: list[Contacts] = []
    low, high = single.min(axis=0), single.max(axis=0)
    for start in range(0, count, _BLOCK):
        for contacts in _draw_contacts(min(_BLOCK, count - start), low, high, rng):
            equivalents = law.equivalents(contacts)
            total = field(equivalents).sum(axis=1)
            if misfit:
                total += _unexplained(field, equivalents, misfit, low, high, rng)
            x, y, growth = np.split(total, 3, axis=1)
            places = pins.rest + np.stack([x, y], axis=-1)
            sizes = resting * np.maximum(1 + growth, 0.1)
            drawn = picture.draw(places, sizes, rng)
            mixed += [Frame(image, 0.0, Pose(), pins.rest_image) for image in drawn]
            mixed_truth += [Contacts.truth(each[:, :2], each[:, 2]) for each in contacts]
    return mixed, mixed_truth


def _unexplained(
    field: Field,
    equivalents: Array,
    misfit: float,
    low: Array,
    high: Array,
    rng: np.random.Generator,
) -> Array:
    """(S, 3 P) smooth random errors of a sum of fields.

    Contacts act on each other in ways that no equivalents hold. A network that never sees that
    takes the smallest bump for one more contact. Equivalents are those that explain most, so that
    what is left is at right angles to every motion of them.
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


def _resting_size(size: Array, moved: Array) -> Array:
    """(P,) size of every pin in the tenth of the frames in which it moves least."""
    distance = np.hypot(*np.split(moved, 2, axis=1))
    least = np.argsort(distance, axis=0)[: max(1, len(distance) // 10)]
    return np.median(np.take_along_axis(size, least, axis=0), axis=0)


def _draw_contacts(
    count: int, low: Array, high: Array, rng: np.random.Generator
) -> list[npt.NDArray[np.float64]]:
    """Contacts in the box low..high, (S, 2, 3) and (S, MOST, 3), not closer than CLOSEST_MM."""
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
