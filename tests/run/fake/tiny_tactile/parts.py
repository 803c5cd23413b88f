"""The frame of a scene shows its tips as numbers; the model reads them with a learned offset."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tactibench import (
    Contacts,
    Encoder,
    FitReport,
    Frame,
    Grid,
    Indenter,
    Model,
    ModelContext,
    Pose,
    Scene,
    Sensor,
    SensorContext,
)
from tactibench.geometry import true_contacts

SCALE = 18.0  # grey levels a millimetre


class TinySensor(Sensor):
    """(5, 4) frames: x, y and depth of up to five tips; the last column says how many touch."""

    pressed: ClassVar[int] = 0

    def __init__(self, context: SensorContext, offset: float = 0.0, instance: int = 0) -> None:
        self.offset = offset + instance
        self.rng = np.random.default_rng(context.seed)

    def rest(self) -> Frame:
        return Frame(np.zeros((5, 4), np.uint8), 0.0, Pose())

    def press(self, scene: Scene) -> Frame:
        type(self).pressed += 1
        image = np.zeros((5, 4), np.uint8)
        truth = true_contacts(scene)
        image[:, 3] = len(truth)
        values = np.column_stack([truth.xy, truth.depth])
        noise = self.rng.uniform(-0.5, 0.5, values.shape)
        image[: len(truth), :3] = np.rint(128 + SCALE * values + self.offset + noise)
        return Frame(image, 0.0, scene.pose)

    def describe(self) -> dict[str, Any]:
        return {"offset": self.offset}

    def surface(self, scene: Scene, grid: Grid) -> np.ndarray:
        return np.full(grid.shape, scene.pose.depth)

    def bound(self, scene: Scene) -> np.ndarray:
        return np.full((len(scene.indenter.offsets), 3), 0.01)


class TinyReference(TinySensor):
    """Four presses that were pushed on to two depths, and one tip outside every workspace."""

    def scenes(self) -> dict[str, Scene]:
        places = {
            "one": (Indenter.single(), 0.0),
            "far": (Indenter.single(), 9.0),
            "pair": (Indenter.dual(7.0), 0.0),
            "wide": (Indenter.dual(12.0), 0.0),
            "three": (Indenter.triple((0.0, 0.0, 0.0)), 0.0),
        }
        return {
            f"{name} {depth}": Scene(indenter, Pose(x, 0.0, 0.0, 0.0, depth))
            for name, (indenter, x) in places.items()
            for depth in (2.0, 4.0)
        }

    def presses(self) -> dict[str, str]:
        return {name: name.partition(" ")[0] for name in self.scenes()}


class TinyModel(Model):
    """Learns the mean offset of depth. Class variables tell the tests what happened."""

    fits: ClassVar[list[int]] = []
    shown: ClassVar[list[list[Frame]]] = []
    fail_in_fit: ClassVar[bool] = False
    behave: ClassVar[str] = "well"

    def __init__(self, context: ModelContext, epochs: int = 3, width: int = 8) -> None:
        self.context = context
        self.epochs = epochs
        self.offset: float | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Contacts],
        *,
        validation: tuple[Sequence[Frame], Sequence[Contacts]],
        rng: np.random.Generator,
        progress: Any,
    ) -> FitReport:
        assert self.context.checkpoints is not None
        state = self.context.checkpoints / "state.json"
        done = json.loads(state.read_text())["epoch"] if state.is_file() else 0
        resumed = done
        progress.start(self.epochs, 1)
        while done < self.epochs:
            done += 1
            state.write_text(json.dumps({"epoch": done}))
            if self.fail_in_fit and done == 2:
                raise KeyboardInterrupt
        self.fits.append(len(frames))
        assert len(validation[0]) == len(validation[1]) > 0
        errors = [t.depth[0] - self._read(f)[0][2] for f, t in zip(frames, truth, strict=True)]
        self.offset = float(np.mean(errors)) + float(rng.normal(0, 1e-3))
        loss = float("nan") if self.behave == "diverge" else 0.5
        return FitReport(done, 0.1, resumed, ({"epoch": 1.0, "loss": np.float64(loss)},))  # type: ignore[dict-item]

    def _read(self, frame: Frame) -> np.ndarray:
        count = int(frame.image[0, 3])
        return (frame.image[:count, :3].astype(np.float64) - 128) / SCALE

    def predict(self, frames: Sequence[Frame]) -> list[Any]:
        assert self.offset is not None
        self.shown.append(list(frames))
        answers: list[Any] = []
        for frame in frames:
            values = self._read(frame)
            depth = values[:, 2] + self.offset
            answers.append(Contacts(values[:, :2], depth, np.ones(len(values))))
        return answers * 2 if self.behave == "twice" else answers

    def maps(self, frames: Sequence[Frame]) -> np.ndarray:
        self._mapped = list(frames)  # zeros say nothing: the answers come from the frames
        maps = np.zeros((len(frames), 1, *self.context.grid.shape), np.float32)
        if self.behave == "nan-maps":
            maps[0, 0, 0, 0] = np.nan
        return maps[:, :, 1:] if self.behave == "small-maps" else maps

    def read_maps(self, _maps: np.ndarray) -> list[Any]:
        return self.predict(self._mapped)

    def save(self, directory: Path) -> None:
        (directory / "offset.json").write_text(json.dumps(self.offset))

    def load(self, directory: Path) -> None:
        self.offset = json.loads((directory / "offset.json").read_text())


class TinyEncoder(Encoder):
    """Draws nothing; the model reads frames and does not ask it."""

    channels = 1

    def __init__(self, blur: float = 2.0) -> None:
        self.blur = blur

    def encode(self, contacts: Contacts, grid: Grid) -> np.ndarray:
        return np.zeros((1, *grid.shape), np.float32)

    def decode(self, maps: np.ndarray, grid: Grid) -> Contacts:
        raise NotImplementedError
