"""Drawn frames of a sensor with 37 pins, for models that read pins."""

import numpy as np

from tactibench import Contacts, Frame, PlatePose, Pose

SIZE = 64
PX_PER_MM = 2.5


def hexagon(rings=3, pitch=8.0, middle=(SIZE - 1) / 2):
    """(P, 2) px: a hexagonal lattice, rows along x."""
    places = [
        (pitch * (i + j / 2), pitch * j * np.sqrt(3) / 2)
        for i in range(-rings, rings + 1)
        for j in range(-rings, rings + 1)
        if abs(i + j) <= rings
    ]
    return np.array(sorted(places, key=lambda xy: (round(xy[1], 6), xy[0]))) + middle


REST = hexagon()


def draw(xy):
    """(64, 64) gray: soft discs at (P, 2) px."""
    axis = np.arange(SIZE)
    square = (axis[None, None, :] - xy[:, 0, None, None]) ** 2
    square = square + (axis[None, :, None] - xy[:, 1, None, None]) ** 2
    return (10 + 220 * np.exp(-square / 4.5).max(axis=0)).astype(np.uint8)


def pushed(x, y, depth):
    """(P, 2) px: pins flee from a contact x, y, depth mm, most at 9 px from it."""
    away = REST - (PX_PER_MM * np.array([x, y]) + (SIZE - 1) / 2)
    square = (away**2).sum(axis=1, keepdims=True)
    return REST + 0.12 * depth * away * np.exp(-square / (2 * 9.0**2))


def press(x, y, depth, rest=True):
    pose = Pose(x, y, 0, 0, depth)
    return Frame(draw(pushed(x, y, depth)), 0.0, pose, draw(REST) if rest else None)


def presses(count, seed, plate=False, rest=True):
    """Frames and truth. A plate tilted by 3 deg presses 1 mm off the middle."""
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    for _ in range(count):
        x, y = rng.uniform(-6, 6, 2)
        depth = rng.uniform(2, 5)
        frames.append(press(x, 0.0 if plate else y, depth, rest))
        truth.append(PlatePose(depth - 5, 3 * x) if plate else Contacts.truth([[x, y]], [depth]))
    return frames, truth
