"""Test presses of a committed record, drawn again from the protocol, and single frames of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames.drawn import frames_of_test, presser_of_test
from tactibench.frames.presser import Presser
from tactibench.geometry import true_contacts
from tactibench.plugins.base import SensorContext
from tactibench.plugins.host import PluginHost
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.files import read_arrays, write_arrays
from tactibench.records.identity import code_hash, digest
from tactibench.records.record import Record
from tactibench.records.store import Arrays
from tactibench.run.components import sensors_of
from tactibench.run.request import RunRequest
from tactibench.run.truth import truth_arrays

_BEHIND = ("tactibench.frames", "tactibench.protocols")
"""Packages whose code draws presses."""
NOISE = 2_000_000
"""Spawn key of frames that are made again one by one: their noise is drawn anew."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """scenes: of all test frames, in the order of the answers. truth: packed, with press and
    group."""

    scenes: tuple[Scene, ...]
    truth: Arrays
    presser: Presser

    def frames(self, rows: Sequence[int]) -> dict[int, npt.NDArray[np.uint8]]:
        """Images of test presses, pressed anew. Raises UserError where the sensor cannot."""
        seed = np.random.SeedSequence(self.presser.keys.data_seed, spawn_key=(NOISE,))
        with self.presser.build(SensorContext(seed)) as sensor:
            return {
                row: np.array(sensor.press(self.scenes[row]).image, dtype=np.uint8) for row in rows
            }


class Drawer:
    """Draws the test presses of one protocol, once for every sensor."""

    def __init__(self, protocol: LoadedProtocol, host: PluginHost, cache: Path) -> None:
        self._protocol, self._host, self._cache = protocol, host, cache
        self._found: dict[str, Drawn | str] = {}

    def drawn(self, record: Record) -> Drawn | str:
        """The presses, or in words why there are none here."""
        sensor = record.sensor
        if sensor.test_sensor is not None:
            return "its test presses are others than the protocol draws"
        key = f"{sensor.name} {sorted(sensor.parameters.items())}"
        if key not in self._found:
            try:
                self._found[key] = self._draw(record)
            except UserError as error:
                self._found[key] = str(error)
        return self._found[key]

    def _draw(self, record: Record) -> Drawn | str:
        keys, stated = self._protocol.keys, record.sensor
        if keys.split is None or keys.answer != "contacts":
            return "the protocol draws no test presses"
        if stated.name not in self._host.sensors.specs:
            return f"sensor {stated.name!r} is not installed here"
        spec = self._host.sensors[stated.name]
        if spec.needs_data:
            return "its presses are in a recording"
        presser = presser_of_test(keys, sensors_of(record, self._host), self._cache)
        scenes, names, groups, radius = self._kept(presser, record.regime)
        answers = [true_contacts(scene, radius) for scene in scenes]
        return Drawn(scenes, truth_arrays(keys, answers, names, groups), presser)

    def _kept(self, presser: Presser, regime: str) -> Presses:
        """Drawn once, then read from the cache, as long as no code behind it has changed."""
        code = [code_hash(name) for name in _BEHIND]
        asked = [self._protocol.hash, presser.part.name, dict(presser.part.values)]
        path = self._cache / "drawn" / f"{digest([*asked, presser.part.code(), code])[:24]}.npz"
        try:
            return unpack_scenes(read_arrays(path))
        except (UserError, KeyError, ValueError, IndexError):
            pass
        keys = self._protocol.keys
        assert keys.split is not None  # noqa: S101 - looked at before
        request = RunRequest(keys.id, "", regime)
        wanted, _ = frames_of_test(request, presser, keys.split)
        found = Presses(
            tuple(scene for one in wanted for scene in one.scenes),
            tuple(press for one in wanted for press in one.clusters),
            tuple(group for one in wanted for group in one.groups),
            presser.pressed.workspace.dome_radius_mm,
        )
        write_arrays(path, pack_scenes(found))
        return found


class Presses(NamedTuple):
    """Scenes of test frames, with press and group of each, on a dome of a radius in mm."""

    scenes: tuple[Scene, ...]
    names: tuple[str, ...]
    groups: tuple[str, ...]
    radius: float


def pack_scenes(presses: Presses) -> Arrays:
    """tips (N,), offsets (sum of tips, 3), radius (N,), kind (N,), pose (N, 5) and the others."""
    scenes = presses.scenes
    return {
        "tips": np.array([len(s.indenter.offsets) for s in scenes], dtype=np.int64),
        "offsets": np.array([o for s in scenes for o in s.indenter.offsets]).reshape(-1, 3),
        "tip_radius": np.array([s.indenter.radius for s in scenes], dtype=np.float64),
        "kind": np.array([s.indenter.name for s in scenes]),
        "pose": np.array([astuple(s.pose) for s in scenes]).reshape(-1, 5),
        "press": np.array(presses.names),
        "group": np.array(presses.groups),
        "radius": np.array(presses.radius),
    }


def unpack_scenes(arrays: Arrays) -> Presses:
    """The inverse of ``pack_scenes``. Raises KeyError or ValueError for other arrays."""
    ends = np.cumsum(arrays["tips"])
    offsets = np.split(arrays["offsets"], ends[:-1])
    columns = (offsets, arrays["tip_radius"], arrays["kind"], arrays["pose"].tolist())
    scenes = tuple(
        Scene(Indenter(float(radius), tuple(map(tuple, part.tolist())), str(kind)), Pose(*pose))
        for part, radius, kind, pose in zip(*columns, strict=True)
    )
    names, groups = (tuple(str(text) for text in arrays[name]) for name in ("press", "group"))
    if not len(scenes) == len(names) == len(groups):
        raise ValueError("presses, names and groups are not equally many")
    return Presses(scenes, names, groups, float(arrays["radius"]))
