"""Simulated frames: generated in chunks, resumed after an interruption, verified when opened.

A chunk's randomness depends on the request and the chunk's number alone, so a data set is the same
however often its making was interrupted.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames.presses import Presses
from tactibench.plugins.base import Sensor, SensorContext
from tactibench.records.files import (
    arrays_hash,
    atomic,
    file_hash,
    read_arrays,
    read_json,
    write_json,
)
from tactibench.records.identity import combined, digest
from tactibench.records.locks import locked

CHUNK = 250
"""Presses in a chunk: about a fifth of a second of work is lost by an interruption."""
MANIFEST = "manifest.json"
PARTS = ("frames", "rest", "poses")
"""Arrays of a data set: (N, H, W[, 3]) and (H, W[, 3]) uint8, (N, 5) x, y mm, yaw, tilt deg, mm."""

Chunk = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class FrameRequest:
    """All that determines a generated data set.

    build: opens the sensor with a seed. identity: of sensor, parameters and code, as JSON.
    scenes, names: of every press. seed: root seed and spawn key of the sensor's randomness.
    dome_radius: of the sensor's surface, mm, inf where it is flat; None: the protocol's.
    secret: whether the seed is known to few and must not be written down.
    """

    name: str
    build: Callable[[SensorContext], Sensor]
    identity: dict[str, Any]
    scenes: tuple[Scene, ...]
    names: tuple[str, ...]
    seed: tuple[int, ...]
    dome_radius: float | None = None
    secret: bool = False

    @cached_property
    def key(self) -> str:
        """Identity of the frames and of their truth: the same key, the same frames and truth."""
        return digest(
            {
                "sensor": self.identity,
                "scenes": digest([_plain(scene) for scene in self.scenes]),
                "seed": self.seed,
                "chunk": CHUNK,
                "numpy": np.__version__,
                **self._surface,
            }
        )

    def content(self, manifest: Mapping[str, Any]) -> str:
        """Of frames, scenes and surface: equal where these are, whatever code made them."""
        scenes = digest([[_plain(scene) for scene in self.scenes], self._surface])
        return combined([*(manifest[part] for part in PARTS), scenes])

    @property
    def _surface(self) -> dict[str, Any]:
        """Said only where it is not the protocol's."""
        if self.dome_radius is None:
            return {}
        # An infinite radius has no meaning in JSON.
        return {"surface": "flat" if math.isinf(self.dome_radius) else self.dome_radius}


def folder_of(cache: Path, key: str) -> Path:
    """Where the frames of a request's key are kept."""
    return cache / "frames" / key[:24]


def is_cached(folder: Path) -> bool:
    """Whether the frames are there (they are verified when they are opened)."""
    return (folder / MANIFEST).is_file()


def open_frames(
    request: FrameRequest, cache: Path, advance: Callable[[int], None] = lambda _: None
) -> Presses:
    """Return the frames, generating what is missing. ``advance`` is told of finished presses.

    Images are mapped from the disk, read-only. Raises UserError when the sensor does not answer
    every scene with a frame of the rest frame's shape.
    """
    folder = folder_of(cache, request.key)
    with locked(folder.with_name(folder.name + ".lock")):
        manifest = _intact(folder, request)
        if manifest is None:
            manifest = _generate(request, folder, advance)
        _clear(folder)
        images = np.load(folder / "frames.npy", mmap_mode="r")
        rest = np.load(folder / "rest.npy")
        poses = np.load(folder / "poses.npy")
    rest.setflags(write=False)
    frames = [
        # A generated frame's time is its number.
        Frame(image, float(i), Pose(*pose), rest)
        for i, (image, pose) in enumerate(zip(images, poses.tolist(), strict=True))
    ]
    return Presses(
        request.name,
        request.scenes,
        frames,
        request.names,
        request.content(manifest),
        folder,
        request.dome_radius,
    )


def _plain(scene: Scene) -> tuple[Any, ...]:
    """The scene as JSON values; several times faster than ``dataclasses.asdict``."""
    indenter, pose = scene.indenter, scene.pose
    # A plate's infinite radius has no meaning in JSON.
    radius = "plate" if indenter.is_plate else indenter.radius
    place = (pose.x, pose.y, pose.yaw, pose.tilt, pose.depth)
    return (indenter.name, radius, indenter.offsets, place)


def _intact(folder: Path, request: FrameRequest) -> dict[str, Any] | None:
    """The manifest, when it and every array are what they were when they were written."""
    try:
        manifest = read_json(folder / MANIFEST)
        whole = manifest["key"] == request.key and all(
            file_hash(folder / f"{part}.npy") == manifest[part] for part in PARTS
        )
    except (UserError, OSError, KeyError, TypeError):
        return None
    return manifest if whole else None


def _generate(
    request: FrameRequest, folder: Path, advance: Callable[[int], None]
) -> dict[str, Any]:
    work = _beside(folder, ".parts")
    work.mkdir(parents=True, exist_ok=True)
    chunks: list[Chunk] = []
    for number, start in enumerate(range(0, len(request.scenes), CHUNK)):
        scenes = request.scenes[start : start + CHUNK]
        path = work / f"chunk-{number:05d}.npz"
        chunk = _finished(path)
        if chunk is None:
            chunk = _press(request, path, number, scenes)
        chunks.append(chunk)
        advance(len(scenes))
    with request.build(SensorContext(_seed(request, 0))) as sensor:
        rest = sensor.rest().image
    arrays = {
        "frames": _joined([chunk["images"] for chunk in chunks], request, rest),
        "rest": rest,
        "poses": np.concatenate([np.empty((0, 5)), *(chunk["poses"] for chunk in chunks)]),
    }
    made = _beside(folder, ".made")
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    for name, array in arrays.items():
        with atomic(made / f"{name}.npy") as stream:
            np.save(stream, array, allow_pickle=False)
    manifest = {
        "key": request.key,
        "name": request.name,
        "presses": len(request.scenes),
        "sensor": request.identity,
        "seed": "hidden" if request.secret else list(request.seed),
        **{part: file_hash(made / f"{part}.npy") for part in PARTS},
    }
    write_json(made / MANIFEST, manifest)
    if folder.exists():  # damaged, or no data set at all
        shutil.rmtree(folder)
    made.rename(folder)
    return manifest


def _joined(
    parts: list[npt.NDArray[np.uint8]], request: FrameRequest, rest: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    for part in parts:
        if part.shape[1:] != rest.shape or part.dtype != np.uint8:
            raise UserError(
                f"sensor {request.identity.get('name')!r} made frames of shape {part.shape[1:]} "
                f"and type {part.dtype}, but its rest frame has {rest.shape} and uint8; "
                "mend the sensor."
            )
    return np.concatenate([np.empty((0, *rest.shape), np.uint8), *parts])


def _press(request: FrameRequest, path: Path, number: int, scenes: tuple[Scene, ...]) -> Chunk:
    with request.build(SensorContext(_seed(request, number))) as sensor:
        frames = list(sensor.press_many(scenes))
    if len(frames) != len(scenes):
        raise UserError(
            f"sensor {request.identity.get('name')!r} made {len(frames)} frames of {len(scenes)} "
            "scenes; mend the sensor."
        )
    chunk: Chunk = {
        "images": np.stack([frame.image for frame in frames]),
        "poses": np.array([astuple(frame.pose) for frame in frames], dtype=np.float64),
    }
    sealed: Chunk = {**chunk, "seal": np.array(arrays_hash(chunk))}
    with atomic(path) as stream:
        np.savez(stream, allow_pickle=False, **sealed)
    return chunk


def _finished(path: Path) -> Chunk | None:
    """A chunk that an earlier, interrupted call completed; anything doubtful is made again."""
    try:
        chunk = read_arrays(path)
        seal = str(chunk.pop("seal"))
    except (UserError, KeyError):
        return None
    return chunk if seal == arrays_hash(chunk) else None


def _clear(folder: Path) -> None:
    """What interrupted calls left beside a finished data set."""
    for leftover in (_beside(folder, ".parts"), _beside(folder, ".made")):
        if leftover.is_dir():
            shutil.rmtree(leftover)


def _beside(folder: Path, suffix: str) -> Path:
    return folder.with_name(folder.name + suffix)


def _seed(request: FrameRequest, chunk: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(request.seed[0], spawn_key=(*request.seed[1:], chunk))
