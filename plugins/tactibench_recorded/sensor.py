"""A recording as a sensor: it answers the presses that it has."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Frame, Indenter, Pose, Scene, SensorContext, UserError
from tactibench_recorded.content import read_content
from tactibench_recorded.labels import read_labels
from tactibench_recorded.layout import find_layout
from tactibench_recorded.png import decode_png, read_file

_THREADS = min(8, os.cpu_count() or 1)
_AHEAD = 8 * _THREADS


class RecordedSensor:
    """Plate presses of a folder with a targets.csv.

    depth of a scene = depth label + ``depth_offset_mm``; tilt = tilt label. The default offset is
    the travel of about 5 mm between the labelled pose and first touch in the Tac-VGNN recordings;
    it moves every depth alike and so changes no error within one recording. Everything is checked
    here, once: raises UserError, which names the file and the row.
    """

    def __init__(
        self,
        context: SensorContext,
        depth_offset_mm: float = 5.0,
        depth: str = "pose_2",
        tilt: str = "pose_6",
        frames: str = "auto",
    ) -> None:
        self._layout = find_layout(context.data, frames)
        targets = read_file(self._layout.targets)
        self._labels = read_labels(self._layout.targets, targets, depth, tilt)
        self._content = read_content(self._layout, targets, self._labels.names)
        self._offset = depth_offset_mm
        self._scenes = _distinct_scenes(self._labels.depth + depth_offset_mm, self._labels.tilt)
        self._row = {scene: row for row, scene in enumerate(self._scenes)}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing stays open between two presses."""

    def scenes(self) -> dict[str, Scene]:
        """Frame name -> scene, in the order of targets.csv; no two scenes are equal."""
        return dict(zip(self._labels.names, self._scenes, strict=True))

    def rest(self) -> Frame:
        """The undeformed sensor. Raises UserError when the recording has no such frame."""
        if self._rest_image is None:
            raise UserError(
                f"{self._layout.frames} has no frame of the undeformed sensor; "
                "add one as init_0.png."
            )
        return Frame(self._rest_image, -1.0, Pose(), self._rest_image)

    def press(self, scene: Scene) -> Frame:
        """The frame of a scene. Raises UserError for a scene that was not recorded."""
        return self._frame(self._find(scene))

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Frames in order, decoded some ahead in threads (decoding releases the GIL)."""
        waiting: deque[Future[Frame]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            try:
                for scene in scenes:
                    waiting.append(pool.submit(self._frame, self._find(scene)))
                    if len(waiting) >= _AHEAD:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()

    def describe(self) -> dict[str, Any]:
        """What determines the frames; the folder's place on this machine does not."""
        kind = self._content.kind
        return {
            "folder": self._layout.folder.resolve().name,
            "frames": self._layout.frames.name,
            "sha256": self._content.sha256,
            "count": len(self._scenes),
            "image": [kind.height, kind.width],
            "channels": 3 if kind.colour else 1,
            "rest": None if self._content.rest is None else self._content.rest.name,
            "columns": dict(self._labels.columns),
            "depth_offset_mm": float(self._offset),
        }

    @cached_property
    def _rest_image(self) -> npt.NDArray[np.uint8] | None:
        path = self._content.rest
        return None if path is None else decode_png(path, self._content.kind)

    def _frame(self, row: int) -> Frame:
        image = decode_png(self._content.paths[row], self._content.kind)
        return Frame(image, float(row), self._scenes[row].pose, self._rest_image)

    def _find(self, scene: Scene) -> int:
        row = self._row.get(scene)
        if row is None:
            pose, depth, tilt = scene.pose, *_ranges(self._scenes)
            raise UserError(
                f"{self._layout.folder} is a recording of {len(self._scenes):,} plate presses "
                f"(depth {depth} mm, tilt {tilt} deg) and has no press of {scene.indenter.name!r} "
                f"at x {pose.x:g} mm, y {pose.y:g} mm, depth {pose.depth:g} mm, "
                f"tilt {pose.tilt:g} deg; use it with a protocol that takes its own presses, "
                "as 'surface' does."
            )
        return row


def _distinct_scenes(
    depth: npt.NDArray[np.float64], tilt: npt.NDArray[np.float64]
) -> tuple[Scene, ...]:
    """One scene a row.

    A pose that was recorded before gets an indenter named 'plate #2', 'plate #3' ..., so that every
    row keeps a scene of its own and can be asked for.
    """
    plate, seen, scenes = Indenter.plate(), Counter[Pose](), []
    for d, t in zip(depth.tolist(), tilt.tolist(), strict=True):
        pose = Pose(tilt=t, depth=d)
        seen[pose] += 1
        again = seen[pose] > 1
        indenter = replace(plate, name=f"{plate.name} #{seen[pose]}") if again else plate
        scenes.append(Scene(indenter, pose))
    return tuple(scenes)


def _ranges(scenes: tuple[Scene, ...]) -> tuple[str, str]:
    depth = [scene.pose.depth for scene in scenes]
    tilt = [scene.pose.tilt for scene in scenes]
    return f"{min(depth):.2f} to {max(depth):.2f}", f"{min(tilt):.1f} to {max(tilt):.1f}"
