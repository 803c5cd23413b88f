"""A model in the loop: from a frame's arrival to the list of contacts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Frame, Model, PlatePose, Pose
from tactibench_tactip.camera.driver import Camera, Shot
from tactibench_tactip.camera.source import Image

WARM_UP = 20


@dataclass(frozen=True, eq=False)
class Seen:
    """One turn of the loop. answer: what the model said. maps: (C, H, W) behind it, or None.
    latency_ms: from the frame's arrival to the answer."""

    shot: Shot
    answer: Contacts | PlatePose | None
    maps: npt.NDArray[Any] | None
    latency_ms: float


@dataclass(frozen=True)
class Latency:
    """Of a loop, ms; waited for the frame is not in it. dropped: frames that came while the model
    was at work, per answered one."""

    p50: float
    p90: float
    p99: float
    mean: float
    count: int
    dropped: float

    @classmethod
    def of(cls, raw_ms: list[float], frames: int) -> Latency:
        """raw_ms: of every turn; frames: that the camera gave meanwhile."""
        p50, p90, p99 = (float(value) for value in np.percentile(raw_ms, (50, 90, 99)))
        lost = max(0, frames - len(raw_ms)) / len(raw_ms)
        return cls(p50, p90, p99, float(np.mean(raw_ms)), len(raw_ms), lost)


def watch(
    camera: Camera, model: Model, rest: Image, turns: int, shown: Callable[[Seen], bool]
) -> Latency:
    """Answer the newest frame, again and again. shown: told of every turn after its time was taken;
    False ends the loop. The first turns warm up and are not counted. Raises CameraError."""
    raw: list[float] = []
    start = 0
    asked_ns = time.monotonic_ns()
    for turn in range(WARM_UP + turns):
        if turn == WARM_UP:
            start = camera.frames
        shot = camera.fresh(asked_ns, 1)[0]
        frame = Frame(shot.image, shot.t_ns * 1e-9, Pose(), rest)
        answer, maps = _answer(model, frame)
        done_ns = time.monotonic_ns()
        asked_ns = done_ns
        latency = (done_ns - shot.t_ns) * 1e-6
        if turn >= WARM_UP:
            raw.append(latency)
        if not shown(Seen(shot, answer, maps, latency)):
            break
    return Latency.of(raw or [float("nan")], camera.frames - start)


def _answer(model: Model, frame: Frame) -> tuple[Any, npt.NDArray[Any] | None]:
    """As a run asks: maps once where the model can show them, then what they say."""
    maps = model.maps([frame])
    if maps is None:
        return model.predict([frame])[0], None
    return model.read_maps(maps)[0], maps[0]
