from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from tiny_tactile.parts import TinyModel, TinySensor

from tactibench import Contacts, FitReport, Frame, Scene


class Still(TinySensor):
    pass


class Threaded(TinySensor):
    """Its frames differ with the number of threads."""

    def press(self, scene: Scene) -> Frame:
        frame = super().press(scene)
        frame.image[2, 2] = int(os.environ["OMP_NUM_THREADS"])
        return frame


class Steady(TinyModel):
    pass


class Shaky(TinyModel):
    def fit(self, *data: Any, **more: Any) -> FitReport:
        report = super().fit(*data, **more)
        assert self.offset is not None
        self.offset += int.from_bytes(os.urandom(4)) / 2**40
        return report


class Moody(TinyModel):
    def predict(self, frames: Sequence[Frame]) -> list[Any]:
        order = list({"x", "y", "depth", "score", "std"})
        mood = sum(1e-3 * 7**at * len(word) for at, word in enumerate(order))
        return [Contacts(one.xy + mood, one.depth, one.score) for one in super().predict(frames)]


class Ill(TinyModel):
    def fit(self, *data: Any, **more: Any) -> FitReport:
        raise ZeroDivisionError("no frames at all")
