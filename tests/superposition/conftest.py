"""A known field of displacements, and a drawn sensor whose pins follow it."""

import numpy as np
import pytest
from drawn_pins import hexagon

from tactibench import Contacts, Frame, Pose
from tactibench.superposition import Field

SIZE = 80
PX_PER_MM = 4.0
RANGE_MM = ((-6.0, -6.0, 0.5), (6.0, 6.0, 5.0))
WIDTH_MM = 3.5


REST = hexagon(4, 8.0, (SIZE - 1) / 2)
"""(61, 2) px: rows of pins from the top down, around the middle of the frame."""


def push(contacts):
    """(N, 2 P) px: pins flee from contacts (N, K, 3) mm; single ones add up."""
    away = REST / PX_PER_MM - (SIZE - 1) / 2 / PX_PER_MM - contacts[..., None, :2]
    fall = np.exp(-(away**2).sum(axis=-1) / (2 * WIDTH_MM**2))
    depth = contacts[..., 2, None]
    way = (0.12 * depth + 0.008 * depth**2) * fall
    return np.concatenate([way * away[..., 0], way * away[..., 1]], axis=-1).sum(axis=1)


def draw(xy):
    """(SIZE, SIZE) uint8: a bright spot at every place (P, 2) px."""
    axis = np.arange(SIZE)
    along = np.exp(-((axis - xy[..., None]) ** 2) / (2 * 1.5**2))
    image = 14 + 200 * np.einsum("px,py->yx", along[:, 0], along[:, 1])
    return np.rint(image).clip(0, 255).astype(np.uint8)


def some(count, rng):
    return rng.uniform(*RANGE_MM, (count, 3))


def pressed(contacts):
    """The drawn frame of contacts (K, 3) mm, and its truth."""
    moved = push(contacts[None])[0].reshape(2, -1).T
    image = draw(REST + moved)
    return (
        Frame(image, 0.0, Pose(), draw(REST)),
        Contacts.truth(contacts[:, :2], contacts[:, 2]),
    )


@pytest.fixture(scope="session")
def pins():
    return REST.copy()


@pytest.fixture(scope="session")
def draw_pins():
    return draw


@pytest.fixture(scope="session")
def push_pins():
    return push


@pytest.fixture(scope="session")
def press():
    return pressed


@pytest.fixture(scope="session")
def random_contacts():
    """(count, 3) mm over the range of the presses."""
    return some


@pytest.fixture(scope="session")
def singles():
    """80 drawn single presses: (frames, truth)."""
    contacts = some(80, np.random.default_rng(11))
    frames, truth = zip(*(pressed(one[None]) for one in contacts), strict=True)
    return list(frames), list(truth)


@pytest.fixture(scope="session")
def field():
    """Learned from 400 presses without noise."""
    contacts = some(400, np.random.default_rng(5))
    return Field.learn(contacts, push(contacts[:, None]))
