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
from tactibench.superposition.field import FEWEST, Field
from tactibench.superposition.neighbours import Neighbours, shipped
from tactibench.superposition.picture import PinPicture
from tactibench.superposition.presses import Eye, as_rows, single_presses

Array = npt.NDArray[np.float64]

MOST = 3
"""Contacts of a mixed frame: 2 or this many, equally often."""
CLOSEST_MM = 5.5
"""Least distance of two contacts: below it the tips of radius 3 mm would meet in the gel."""
_BLOCK = 500


def mix(
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    count: int,
    rng: np.random.Generator,
    neighbours: Neighbours | None = None,
) -> tuple[list[Frame], list[Contacts]]:
    """``count`` frames with two or three contacts, and their truth.

    Only frames with one contact are looked at; places and depths are drawn over their range.
    Raises UserError for fewer than twenty of them or frames without a rest image.
    """
    rows = single_presses(truth)
    if len(rows) < FEWEST:
        raise UserError(
            f"contact mixing needs at least {FEWEST} single presses and found {len(rows)}; "
            "raise the training count, or leave mixing out."
        )
    pressed = [frames[int(row)] for row in rows]
    eye = Eye.of(pressed)
    images = eye.images(pressed)
    single = as_rows([truth[int(row)] for row in rows])[:, 0]
    moved = eye.moved(images)
    pins = _positions(eye, moved)
    picture = PinPicture.learn(images, pins)
    resting = _resting_size(picture, images, pins, moved)
    grown = picture.measure(images, pins) / resting - 1
    field = Field.learn(single, np.concatenate([moved, grown], axis=1))
    law = neighbours or shipped()

    made: list[Frame] = []
    wanted: list[Contacts] = []
    low, high = single.min(axis=0), single.max(axis=0)
    for start in range(0, count, _BLOCK):
        for contacts in _drawn(min(_BLOCK, count - start), low, high, rng):
            total = field(law.equivalents(contacts)).sum(axis=1)
            parts = np.split(total, 3, axis=1)
            places = eye.rest + np.stack(parts[:2], axis=-1)
            sizes = resting * np.maximum(1 + parts[2], 0.1)
            drawn = picture.draw(places, sizes, rng)
            made += [Frame(image, 0.0, Pose(), eye.still) for image in drawn]
            wanted += [Contacts.truth(one[:, :2], one[:, 2]) for one in contacts]
    return made, wanted


def _positions(eye: Eye, moved: Array) -> Array:
    """(N, P, 2) px."""
    return eye.rest + moved.reshape(len(moved), 2, -1).transpose(0, 2, 1)


def _resting_size(
    picture: PinPicture, images: npt.NDArray[np.uint8], pins: Array, moved: Array
) -> Array:
    """(P,) size of every pin in the tenth of the frames in which it moves least."""
    size = picture.measure(images, pins)
    way = np.hypot(*np.split(moved, 2, axis=1))
    least = np.argsort(way, axis=0)[: max(1, len(way) // 10)]
    return np.median(np.take_along_axis(size, least, axis=0), axis=0)


def _drawn(
    count: int, low: Array, high: Array, rng: np.random.Generator
) -> list[npt.NDArray[np.float64]]:
    """Contacts in the box low..high, (S, 2, 3) and (S, MOST, 3), not closer than CLOSEST_MM."""
    several = int((rng.random(count) < 0.5).sum())
    groups = [(count - several, 2), (several, MOST)]
    return [_apart(many, each, low, high, rng) for many, each in groups if many]


def _apart(count: int, each: int, low: Array, high: Array, rng: np.random.Generator) -> Array:
    found: list[Array] = []
    missing = count
    for _ in range(200):
        tried = rng.uniform(low, high, (4 * missing + 8, each, 3))
        gaps = [
            np.hypot(*(tried[:, i, :2] - tried[:, j, :2]).T) for i in range(each) for j in range(i)
        ]
        found.append(tried[np.min(gaps, axis=0) >= CLOSEST_MM][:missing])
        missing -= len(found[-1])
        if not missing:
            return np.concatenate(found)
    raise UserError(
        f"the single presses cover {high[0] - low[0]:.1f} x {high[1] - low[1]:.1f} mm, too little "
        f"for {each} contacts {CLOSEST_MM:g} mm apart; press a wider range or leave mixing out."
    )
