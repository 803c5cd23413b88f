"""Simulated frames: generated in chunks, resumed after an interruption, verified when opened.

A chunk's randomness depends on the request and the chunk's number alone, so a data set is the same
however often its making was interrupted.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.contacts import Frame, Scene
from tactibench.datasets.presses import Presses
from tactibench.plugins.interfaces import Sensor, SensorContext
from tactibench.records.files import atomic, file_hash, locked, read_json, write_json
from tactibench.records.identity import combined, digest

CHUNK = 250
"""Presses in a chunk: about a fifth of a second of work is lost by an interruption."""


@dataclass(frozen=True)
class FrameRequest:
    """All that determines a generated data set.

    build: opens the sensor with a seed. identity: of sensor, parameters and code, as JSON.
    """

    name: str
    build: Callable[[SensorContext], Sensor]
    identity: dict[str, Any]
    scenes: tuple[Scene, ...]
    seed: tuple[int, ...]

    @property
    def key(self) -> str:
        """Identity of the frames: the same key, the same frames."""
        return digest(
            {
                "sensor": self.identity,
                "scenes": digest([asdict(s) for s in self.scenes]),
                "seed": self.seed,
                "chunk": CHUNK,
                "numpy": np.__version__,
            }
        )


def folder_of(request: FrameRequest, cache: Path) -> Path:
    """Where the frames of a request are kept."""
    return cache / "frames" / request.key[:24]


def is_cached(request: FrameRequest, cache: Path) -> bool:
    """Whether the frames are there (they are verified when they are opened)."""
    return (folder_of(request, cache) / "manifest.json").is_file()


def open_frames(
    request: FrameRequest, cache: Path, advance: Callable[[int], None] = lambda _: None
) -> Presses:
    """Return the frames, generating what is missing. ``advance`` is told of finished presses."""
    folder = folder_of(request, cache)
    with locked(folder.with_name(folder.name + ".lock")):
        if not _intact(folder, request):
            shutil.rmtree(folder, ignore_errors=True)
            _generate(request, folder, advance)
    images = np.load(folder / "frames.npy", mmap_mode="r")
    rest = np.load(folder / "rest.npy")
    manifest = read_json(folder / "manifest.json")
    frames = [
        Frame(images[i], float(i), scene.pose, rest)  # a simulated frame's time is its number
        for i, scene in enumerate(request.scenes)
    ]
    names = tuple(f"{request.name}-{i}" for i in range(len(frames)))
    content = combined([manifest["frames"], manifest["rest"], request.key])
    return Presses(request.name, request.scenes, frames, names, content, folder)


def _intact(folder: Path, request: FrameRequest) -> bool:
    path = folder / "manifest.json"
    if not path.is_file():
        return False
    manifest = read_json(path)
    return bool(
        manifest["key"] == request.key
        and all(
            (folder / f"{part}.npy").is_file()
            and file_hash(folder / f"{part}.npy") == manifest[part]
            for part in ("frames", "rest")
        )
    )


def _generate(request: FrameRequest, folder: Path, advance: Callable[[int], None]) -> None:
    work = folder.with_name(folder.name + ".parts")
    work.mkdir(parents=True, exist_ok=True)
    chunks: list[Path] = []
    for number, start in enumerate(range(0, len(request.scenes), CHUNK)):
        scenes = request.scenes[start : start + CHUNK]
        chunk = _finished(work, number) or _press(request, work, number, scenes)
        chunks.append(chunk)
        advance(len(scenes))
    parts = [np.load(chunk) for chunk in chunks]
    with request.build(SensorContext(_seed(request, 0))) as sensor:
        rest = sensor.rest().image
    shape = rest.shape
    frames = np.concatenate([np.empty((0, *shape), np.uint8), *parts])
    made = folder.with_name(folder.name + ".made")
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    for name, array in (("frames", frames), ("rest", rest)):
        with atomic(made / f"{name}.npy") as stream:
            np.save(stream, array, allow_pickle=False)
    manifest = {
        "key": request.key,
        "name": request.name,
        "presses": len(request.scenes),
        "sensor": request.identity,
        "seed": list(request.seed),
        "frames": file_hash(made / "frames.npy"),
        "rest": file_hash(made / "rest.npy"),
    }
    write_json(made / "manifest.json", manifest)
    made.rename(folder)
    shutil.rmtree(work)


def _press(request: FrameRequest, work: Path, number: int, scenes: tuple[Scene, ...]) -> Path:
    with request.build(SensorContext(_seed(request, number))) as sensor:
        images = np.stack([frame.image for frame in sensor.press_many(scenes)])
    path = work / f"chunk-{number:05d}.npy"
    with atomic(path) as stream:
        np.save(stream, images, allow_pickle=False)
    with atomic(path.with_suffix(".sha256")) as stream:
        stream.write(file_hash(path).encode())
    return path


def _finished(work: Path, number: int) -> Path | None:
    """A chunk that an earlier, interrupted call completed; anything doubtful is made again."""
    path = work / f"chunk-{number:05d}.npy"
    seal = path.with_suffix(".sha256")
    if path.is_file() and seal.is_file() and seal.read_text() == file_hash(path):
        return path
    return None


def _seed(request: FrameRequest, chunk: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(request.seed[0], spawn_key=(*request.seed[1:], chunk))
