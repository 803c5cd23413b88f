"""Frames of a drawn press, a bright spot, and a short training on them."""

import math

import numpy as np
from silent import Epochs

from tactibench import Contacts, Frame, PlatePose, Pose


def press(x, y, depth, size=64):
    """A bright spot whose place and width tell the contact."""
    axis = (np.arange(size) + 0.5) / size * 25.6 - 12.8
    square = (axis[None, :] - x) ** 2 + (axis[:, None] - y) ** 2
    image = 20 + 200 * np.exp(-square / (2 * (0.5 + depth / 2) ** 2))
    return Frame(image.astype(np.uint8), 0.0, Pose(x, y, 0, 0, depth))


def presses(count, seed, plate=False):
    """Contacts, or plates with labels from -4 to 1 mm, as a robot's z."""
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    for _ in range(count):
        x, y = rng.uniform(-6, 6, 2)
        depth = rng.uniform(1, 6)
        frames.append(press(x, 0.0 if plate else y, depth))
        if plate:
            truth.append(PlatePose(depth - 5, math.degrees(math.asin(x / 20))))
        else:
            truth.append(Contacts.truth([[x, y]], [depth]))
    return frames, truth


def fit(model, count=24, seed=3, plate=False, progress=None):
    """Train on a few presses; returns the report."""
    frames, truth = presses(count, 1, plate)
    return model.fit(
        frames,
        truth,
        validation=presses(6, 2, plate),
        rng=np.random.default_rng(seed),
        progress=progress or Epochs(),
    )
