"""A simulated TacTip under the page, and a model that says what a test wants."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, Grid, SensorContext, open_sensor
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.live import PressSession, Subject

GRID = Grid.centred(64, 0.4)


class Sayer(StubModel):
    """Says what it is told to say to any frame; keeps the frames."""

    def __init__(self) -> None:
        self.says: Any = Contacts.none()
        self.frames: list[Frame] = []

    def predict(self, frames: Sequence[Frame]) -> Any:
        self.frames += frames
        if isinstance(self.says, Exception):
            raise self.says
        return [self.says for _ in frames]


@pytest.fixture
def sayer() -> Sayer:
    return Sayer()


def make_sensor(instance: int) -> Any:
    context = SensorContext(np.random.SeedSequence(0))
    return open_sensor("tactip-127", context, {"instance": str(instance)})


@pytest.fixture
def session(sayer: Sayer) -> PressSession:
    made = PressSession(
        make_sensor,
        [Subject("sayer", sayer)],
        GRID,
        dome_radius_mm=DOME_RADIUS_MM,
        gate_mm=3.0,
    )
    sayer.frames.clear()
    return made


def unpacked(message: bytes) -> dict[str, Any]:
    """Head of a message, its pictures as arrays: what page.js does."""
    (length,) = struct.unpack_from("<I", message)
    head: dict[str, Any] = json.loads(message[4 : 4 + length])
    for name, (kind, height, width, start) in head["pictures"].items():
        values = np.frombuffer(message, f"<{kind}", height * width, 4 + length + start)
        head["pictures"][name] = values.reshape(height, width)
    return head


@pytest.fixture
def read() -> Callable[[bytes], dict[str, Any]]:
    return unpacked
