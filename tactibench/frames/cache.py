"""Generated frames: made in chunks, resumed after an interruption, verified when opened.

A chunk's randomness depends on the recipe and the chunk's number alone, so a set of frames is the
same however often its making was interrupted.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose, Scene, Signal
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.frames.source import Advance, FrameSet
from tactibench.plugins import Sensor, SensorContext
from tactibench.protocols import CHUNK
from tactibench.records import (
    CacheEntry,
    beside,
    combined,
    digest,
    read_checked_arrays,
    write_checked_arrays,
)

ARRAYS = ("frames", "rest", "poses")
"""Files of a set: (N, ...) signals of all frames; (...) signal of the undeformed sensor; (N, 5)
poses x, y mm, yaw, tilt deg, depth mm, or (N, 8) with dx, dy mm and dyaw deg where a press moved
sideways."""
REST_ARRAYS = ("rests", "rest_of")
"""Further files of a set whose frames are of several sensor instances: (K, ...) the different rest
signals, and (N,) the number of the rest signal of each frame."""
FORCE = "forces"
"""Further file of a set whose sensor tells the forces of contacts: (N, K, 3) N, NaN for none."""

Chunk = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class GeneratedFrameSet(FrameSet):
    """Frames that a sensor makes when they are opened, and that are cached.

    Attributes:
        build: Opens the sensor with a seed.
        identity: Identity of sensor, parameters and code, as JSON values.
        seed: Root seed and spawn key of the sensor's randomness.
        cache: Folder of all caches.
        dome_radius: Radius of the sensor's surface, mm, inf where it is flat; None: the protocol's.
        secret: Whether the seed is known to few and must not be written down.
    """

    build: Callable[[SensorContext], Sensor]
    identity: dict[str, Any]
    seed: tuple[int, ...]
    cache: Path
    dome_radius: float | None = None
    secret: bool = False

    @cached_property
    def key(self) -> str:
        """Return the identity of frames and truth: equal keys, equal frames and truth."""
        return digest(
            {
                "sensor": self.identity,
                "scenes": digest([_as_json(scene) for scene in self.scenes]),
                "seed": self.seed,
                "chunk": CHUNK,
                "numpy": np.__version__,
                **self._surface,
            }
        )

    @property
    def entry(self) -> CacheEntry:
        """Return the place of the frames in the cache."""
        return CacheEntry(self.cache / "frames" / self.key[:24], self.key)

    @property
    def cached(self) -> bool:
        """Return whether the frames are in the cache."""
        return self.entry.cached

    def remove(self) -> None:
        """Remove the frames from the cache, so that they are made anew."""
        self.entry.remove()

    def open_sensor(self, chunk: int = 0) -> Sensor:
        """Return the sensor with the randomness of one chunk."""
        seed = np.random.SeedSequence(self.seed[0], spawn_key=(*self.seed[1:], chunk))
        return self.build(SensorContext(seed))

    def open(self, advance: Advance) -> Presses:
        """Return the frames, generating what is missing.

        Images are mapped from the disk, read-only.

        Raises:
            UserError: The sensor does not make one frame per scene, or the frames do not have the
                shape and the type of the rest frame.
        """
        entry = self.entry
        folder = entry.folder
        with entry.locked():
            manifest = entry.read() or _generate(self, entry, advance)
            shutil.rmtree(beside(folder, ".parts"), ignore_errors=True)
            signals = np.load(folder / "frames.npy", mmap_mode=None if self.secret else "r")
            rests = np.load(folder / "rest.npy")[np.newaxis]
            rest_of = np.zeros(len(signals), dtype=np.intp)
            if f"{REST_ARRAYS[0]}.npy" in manifest["files"]:
                rests, rest_of = (np.load(folder / f"{name}.npy") for name in REST_ARRAYS)
            poses = np.load(folder / "poses.npy")
            forces: list[npt.NDArray[np.float64] | None] = [None] * len(signals)
            if f"{FORCE}.npy" in manifest["files"]:
                forces = [row[~np.isnan(row[:, 0])] for row in np.load(folder / f"{FORCE}.npy")]
            if self.secret:  # their poses stay on the disk for nobody
                shutil.rmtree(folder)
        rests.setflags(write=False)
        shared = list(rests)  # frames of one instance hold one and the same array
        frames = [
            # A generated frame's time is its number.
            Frame(signal, float(i), Pose(*pose), shared[number], force)
            for i, (signal, pose, number, force) in enumerate(
                zip(signals, poses.tolist(), rest_of.tolist(), forces, strict=True)
            )
        ]
        content, place = self._content_hash(manifest["files"]), None if self.secret else folder
        return Presses(self.name, self.scenes, frames, self.names, content, place, self.dome_radius)

    def _content_hash(self, files: Mapping[str, str]) -> str:
        """Return a hash of frames, scenes and surface, which does not depend on the code.

        Args:
            files: Hash of every file, by its name.
        """
        scenes = digest([[_as_json(scene) for scene in self.scenes], self._surface])
        names = [f"{name}.npy" for name in (*ARRAYS, *REST_ARRAYS, FORCE)]
        return combined([*(files[name] for name in names if name in files), scenes])

    @property
    def _surface(self) -> dict[str, Any]:
        """The surface; empty where it is the protocol's."""
        if self.dome_radius is None:
            return {}
        # An infinite radius has no meaning in JSON.
        return {"surface": "flat" if math.isinf(self.dome_radius) else self.dome_radius}


def _as_json(scene: Scene) -> tuple[Any, ...]:
    """Return the scene as JSON values; several times faster than ``dataclasses.asdict``."""
    indenter, pose = scene.indenter, scene.pose
    # A plate's infinite radius has no meaning in JSON.
    radius = "plate" if indenter.is_plate else indenter.radius
    place: tuple[float, ...] = (pose.x, pose.y, pose.yaw, pose.tilt, pose.depth)
    if pose.moved:  # the key of a pose that did not move stays what it was
        place += (pose.dx, pose.dy, pose.dyaw)
    return (indenter.name, radius, indenter.offsets, place)


def _generate(
    frame_set: GeneratedFrameSet, entry: CacheEntry, advance: Callable[[int], None]
) -> dict[str, Any]:
    """Make the frames of a set, store them, and return their manifest."""
    chunks: list[Chunk] = []
    for number, start in enumerate(range(0, len(frame_set.scenes), CHUNK)):
        scenes = frame_set.scenes[start : start + CHUNK]
        path = beside(entry.folder, ".parts") / f"chunk-{number:05d}.npz"
        chunk = read_checked_arrays(path)
        if chunk is None:
            chunk = _press(frame_set, number, scenes)
            write_checked_arrays(path, chunk, compress=False)
        chunks.append(chunk)
        advance(len(scenes))
    with frame_set.open_sensor(0) as sensor:
        rest = sensor.rest().signal
    arrays = {
        "frames": _join_signals([chunk["images"] for chunk in chunks], frame_set, rest),
        "rest": rest,
        "poses": np.concatenate([chunk["poses"] for chunk in chunks] or [np.empty((0, 5))]),
        **_join_rests(chunks, rest),
    }
    if chunks and FORCE in chunks[0]:
        arrays[FORCE] = np.concatenate([chunk[FORCE] for chunk in chunks])

    def fill(folder: Path) -> dict[str, Any]:
        for name, array in arrays.items():
            np.save(folder / f"{name}.npy", array, allow_pickle=False)
        return {
            "name": frame_set.name,
            "presses": len(frame_set.scenes),
            "sensor": frame_set.identity,
            "seed": "hidden" if frame_set.secret else list(frame_set.seed),
        }

    return entry.write(fill)


def _press(frame_set: GeneratedFrameSet, number: int, scenes: tuple[Scene, ...]) -> Chunk:
    with frame_set.open_sensor(number) as sensor:
        frames = list(sensor.press_many(scenes))
    if len(frames) != len(scenes):
        raise _wrong(frame_set, f"{len(frames)} frames of {len(scenes)} scenes")
    for frame in frames:
        if frame.rest is not None and frame.rest.shape != frame.signal.shape:
            shapes = f"{frame.signal.shape} with a rest frame of shape {frame.rest.shape}"
            raise _wrong(frame_set, f"a frame of shape {shapes}")
    columns = 8 if any(scene.pose.moved for scene in frame_set.scenes) else 5
    most = max(len(scene.indenter.offsets) for scene in frame_set.scenes)
    forces = [
        np.pad(frame.force, ((0, most - len(frame.force)), (0, 0)), constant_values=np.nan)
        for frame in frames
        if frame.force is not None
    ]
    return {
        "images": np.stack([frame.signal for frame in frames]),
        "poses": np.array([astuple(frame.pose)[:columns] for frame in frames], dtype=np.float64),
        **_rests_of(frames),
        **({FORCE: np.stack(forces)} if len(forces) == len(frames) else {}),
    }


def _wrong(frame_set: GeneratedFrameSet, made: str) -> UserError:
    return UserError(f"sensor {frame_set.identity.get('name')!r} made {made}; fix the sensor.")


def _rests_of(frames: Sequence[Frame]) -> Chunk:
    """Return the different rest signals of a chunk and the number of each frame's, -1 for none."""
    different: dict[bytes, Signal] = {}
    rest_of = np.full(len(frames), -1, dtype=np.intp)
    for row, frame in enumerate(frames):
        if frame.rest is not None:
            content = frame.rest.tobytes()
            different.setdefault(content, frame.rest)
            rest_of[row] = list(different).index(content)
    rests = np.array(list(different.values()), dtype=frames[0].signal.dtype)
    return {"rests": rests, "rest_of": rest_of}


def _join_rests(chunks: Sequence[Chunk], rest: Signal) -> Chunk:
    """Return ``REST_ARRAYS``, the sensor's own rest signal first; {} where no frame has another."""
    different = {rest.tobytes(): rest}
    rest_of = []
    for chunk in chunks:
        keys = [array.tobytes() for array in chunk["rests"]]
        different.update(zip(keys, chunk["rests"], strict=True))
        order = {key: number for number, key in enumerate(different)}
        numbers = np.array([*(order[key] for key in keys), 0])  # the last one for frames without
        rest_of.append(numbers[chunk["rest_of"]])
    if len(different) == 1:
        return {}
    return dict(
        zip(REST_ARRAYS, (np.stack(list(different.values())), np.concatenate(rest_of)), strict=True)
    )


def _join_signals(
    chunks: Sequence[npt.NDArray[Any]], frame_set: GeneratedFrameSet, rest: Signal
) -> npt.NDArray[Any]:
    if rest.dtype not in (np.uint8, np.float32):
        raise _wrong(frame_set, f"a rest frame of type {rest.dtype}, neither uint8 nor float32")
    for signals in chunks:
        if signals.shape[1:] != rest.shape or signals.dtype != rest.dtype:
            given = f"frames of shape {signals.shape[1:]} and type {signals.dtype}"
            raise _wrong(
                frame_set, f"{given}, but its rest frame has {rest.shape} and {rest.dtype}"
            )
    return np.concatenate([np.empty((0, *rest.shape), rest.dtype), *chunks])
