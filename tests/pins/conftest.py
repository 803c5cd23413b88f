"""Drawn frames of a sensor with 37 pins that flee from a press or a plate."""

import numpy as np
import pytest

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose

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
    axis = np.arange(SIZE)
    square = (axis[None, None, :] - xy[:, 0, None, None]) ** 2
    square = square + (axis[None, :, None] - xy[:, 1, None, None]) ** 2
    return (10 + 220 * np.exp(-square / 4.5).max(axis=0)).astype(np.uint8)


def pushed(x, y, depth):
    """Pins flee from the contact, most at 9 px from it."""
    away = REST - (PX_PER_MM * np.array([x, y]) + (SIZE - 1) / 2)
    square = (away**2).sum(axis=1, keepdims=True)
    return REST + 0.12 * depth * away * np.exp(-square / (2 * 9.0**2))


def press(x, y, depth, rest=True):
    return Frame(draw(pushed(x, y, depth)), 0.0, Pose(), draw(REST) if rest else None)


def presses(count, seed, plate=True, rest=True):
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    for _ in range(count):
        x, y = rng.uniform(-6, 6, 2)
        depth = rng.uniform(2, 5)
        frames.append(press(x, 0.0 if plate else y, depth, rest))
        truth.append(PlatePose(depth - 5, 3 * x) if plate else Contacts.truth([[x, y]], [depth]))
    return frames, truth


class Silent:
    def start(self, epochs, steps): ...

    def step(self, loss): ...

    def epoch(self, epoch, loss, validation_mm): ...


@pytest.fixture(scope="session")
def make_presses():
    return presses


@pytest.fixture(scope="session")
def make_model():
    from tactibench_pins.kernel import Kernel
    from tactibench_pins.model import Pins

    def _make(name, answer="plate", checkpoints=None, **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0, checkpoints=checkpoints)
        if name == "kernel":
            return Kernel(context)
        return Pins(context, **{"members": 2, "width": 32, "epochs": 300} | parameters)

    return _make


@pytest.fixture(scope="session")
def fit():
    def _fit(model, count=150, seed=3, plate=True, rest=True, held=30):
        frames, truth = presses(count, 1, plate, rest)
        return model.fit(
            frames,
            truth,
            validation=presses(held, 2, plate),
            rng=np.random.default_rng(seed),
            progress=Silent(),
        )

    return _fit


@pytest.fixture(scope="session")
def taught(make_model, fit):
    """By name: a model that learned plates, and the report of its training."""
    made = {}
    for name in ("kernel", "pins"):
        model = make_model(name)
        made[name] = model, fit(model)
    return made
