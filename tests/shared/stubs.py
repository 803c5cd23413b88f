"""Plugin classes whose required methods fail; a test writes those that it needs."""

from __future__ import annotations

from typing import Any

from tactibench import Encoder, Model, Sensor


class StubModel(Model):
    def fit(self, *data: Any, **more: Any) -> Any:
        raise NotImplementedError

    def predict(self, frames: Any) -> Any:
        raise NotImplementedError

    def save(self, directory: Any) -> None:
        raise NotImplementedError

    def load(self, directory: Any) -> None:
        raise NotImplementedError


class StubSensor(Sensor):
    def rest(self) -> Any:
        raise NotImplementedError

    def press(self, scene: Any) -> Any:
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        return {}


class StubEncoder(Encoder):
    def encode(self, contacts: Any, grid: Any) -> Any:
        raise NotImplementedError

    def decode(self, maps: Any, grid: Any) -> Any:
        raise NotImplementedError
