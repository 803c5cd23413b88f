"""A recording as a sensor: it answers the presses that it has."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError
from tactibench.datasets.importing import ImportOptions, Recording
from tactibench_recorded.scenes import Pressed, kinds_of, pressed

_THREADS = min(8, os.cpu_count() or 1)
_AHEAD = 8 * _THREADS
OFFSET_MM, PIVOT_MM = 5.0, 0.0
"""What labels are read by where nothing is said."""


class RecordedSensor(Sensor):
    """The presses of a folder: Bristol, CSV, Hugging Face image folder, or v1 data set.

    Scenes that the folder knows (v1 data sets, tables with x_mm, y_mm and depth_mm) are taken as
    they are. Other labels are read as a plate's: depth = depth label + ``depth_offset_mm`` +
    ``pivot_mm`` (1 - cos tilt), tilt = tilt label. The default offset is the travel of about 5 mm
    between the labelled pose and first touch in the Tac-VGNN recordings; it moves every depth alike
    and so changes no error within one recording. Where depths of two sensors are compared
    (``context.indentation``) and neither number is given, or with ``labels`` "fitted", both are
    fitted to the pins. ``split`` names a split of a data set, which then says who trains, validates
    and tests. Everything is checked here, once: raises UserError, which names the file and the row.
    """

    def __init__(
        self,
        context: SensorContext,
        depth_offset_mm: float = OFFSET_MM,
        pivot_mm: float = PIVOT_MM,
        labels: str = "auto",
        depth: str = "pose_2",
        tilt: str = "pose_6",
        frames: str = "auto",
        split: str = "",
    ) -> None:
        if context.data is None:
            raise UserError(
                "sensor 'recorded' needs --data FOLDER, a folder that holds targets.csv and its "
                "frames, or a data set."
            )
        options = ImportOptions(
            frames=frames, depth=depth, tilt=tilt, offset_mm=depth_offset_mm, pivot_mm=pivot_mm
        )
        given = (depth_offset_mm, pivot_mm) != (OFFSET_MM, PIVOT_MM)
        fitted = labels == "fitted" or (labels == "auto" and context.indentation and not given)
        self._pressed = pressed(context.data, options, fitted=fitted, split=split)
        self._row = {scene: number for number, scene in enumerate(self._pressed.scenes)}
        radius = self._recording.dome_radius_mm
        if radius is not None and self._recording.dataset is not None:
            self.dome_radius_mm = radius

    def scenes(self) -> dict[str, Scene]:
        """Frame name -> scene, in the order of the table; no two scenes are equal."""
        return dict(zip(self._pressed.names, self._pressed.scenes, strict=True))

    def presses(self) -> dict[str, str]:
        """Frame name -> press; frames of one press share it."""
        return dict(zip(self._pressed.names, self._pressed.presses, strict=True))

    def split(self) -> Mapping[str, str]:
        """Frame name -> part of the split; {} without one."""
        return self._pressed.parts

    def rest(self) -> Frame:
        """The undeformed sensor. Raises UserError when the recording has no such frame."""
        if self._rest_image is None:
            raise UserError(
                f"{self._recording.frames} has no frame of the undeformed sensor; "
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
        recording, options = self._recording, self._pressed.options
        rest = None if recording.rest is None else recording.rest.name
        if recording.dataset is not None and self._rest_image is not None:
            rest = "rest"
        return {
            "format": recording.format,
            "folder": recording.folder.resolve().name,
            "frames": recording.frames.name,
            "sha256": recording.sha256,
            "count": len(self._pressed.scenes),
            "image": [recording.kind.height, recording.kind.width],
            "channels": recording.channels,
            "rest": rest,
            "columns": dict(self._pressed.columns),
            "depth_offset_mm": float(options.offset_mm),
            "pivot_mm": float(options.pivot_mm),
        }

    @property
    def _recording(self) -> Recording:
        return self._pressed.recording

    @cached_property
    def _rest_image(self) -> npt.NDArray[np.uint8] | None:
        return self._recording.rest_image()

    def _frame(self, number: int) -> Frame:
        image = self._recording.image(self._pressed.rows[number])
        return Frame(image, float(number), self._pressed.scenes[number].pose, self._rest_image)

    def _find(self, scene: Scene) -> int:
        number = self._row.get(scene)
        if number is None:
            raise UserError(_not_there(self._pressed, scene))
        return number


def _not_there(pressed: Pressed, scene: Scene) -> str:
    poses, pose = [scene.pose for scene in pressed.scenes], scene.pose
    depth, tilt = [pose.depth for pose in poses], [pose.tilt for pose in poses]
    kinds = kinds_of(pressed.scenes)
    what = "plate presses" if kinds == ["plate"] else f"presses by {', '.join(kinds)}"
    return (
        f"{pressed.recording.folder} is a recording of {len(poses):,} {what} "
        f"(depth {min(depth):.2f} to {max(depth):.2f} mm, tilt {min(tilt):.1f} to {max(tilt):.1f} "
        f"deg) and has no press of {scene.indenter.name!r} at x {pose.x:g} mm, y {pose.y:g} mm, "
        f"depth {pose.depth:g} mm, tilt {pose.tilt:g} deg; use it with a protocol that takes its "
        "own presses, as 'surface' does."
    )
