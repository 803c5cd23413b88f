"""A recording as a sensor: it answers the presses that it has."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy.typing as npt

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError
from tactibench.datasets import (
    ChannelKind,
    ImportOptions,
    Recording,
    RecordingFit,
    cached_report,
    own_workspace,
)
from tactibench_recorded.scenes import RecordedPresses, indenter_names, open_presses

_THREADS = min(8, os.cpu_count() or 1)
_PREFETCH = 8 * _THREADS
"""Frames that are decoded ahead: enough for all threads, few enough for any memory."""
OFFSET_MM, PIVOT_MM = 5.0, 0.0
"""Offset and pivot of labels where no parameter gives them."""


class RecordedSensor(Sensor):
    """A sensor that answers the presses of a folder of recorded frames.

    The folder is of the Bristol convention, has a CSV file, is a Hugging Face image folder, or a
    data set. Scenes that it knows (data sets, tables with x_mm, y_mm and depth_mm) are taken as
    they are. Other labels are read as a plate's: depth = depth label + ``depth_offset_mm`` +
    ``pivot_mm`` (1 - cos tilt) + ``pivot_side_mm`` sin tilt, tilt = tilt label. Everything is
    checked when the sensor is built.

    Args:
        context: Circumstances of the run, with the folder in ``context.data``.
        depth_offset_mm: Offset of the depth label. The default is the travel of about 5 mm between
            the labelled pose and first touch in the Tac-VGNN recordings; it moves every depth alike
            and so changes no error within one recording.
        pivot_mm: Factor p of the depth above.
        pivot_side_mm: Factor q of the depth above.
        fit_side: Whether q is fitted, too, where labels are fitted; it is 0 otherwise.
        labels: "given": read with these three numbers; "fitted": all three are fitted to the pins,
            and labels that the pins contradict are refused; "auto": fitted where depths of two
            sensors are compared (``context.indentation``) and no number is given.
        depth: Column with the depth label, mm.
        tilt: Column with the tilt label, deg.
        frames: Folder of the frames; "auto": the first of the usual folders that is there.
        split: Name of a split of a data set, which then says what trains, validates and tests.
        range: Presses that protocols of tips take: "published", those in their published range;
            "own", all; "auto", all of a flat sensor, otherwise those in the published range.
        trust_labels: Whether to take labels that the frames contradict; otherwise they are refused.

    Raises:
        UserError: A file is missing or damaged, or the frames contradict the labels; the message
            names file and row.
    """

    def __init__(
        self,
        context: SensorContext,
        depth_offset_mm: float = OFFSET_MM,
        pivot_mm: float = PIVOT_MM,
        pivot_side_mm: float = 0.0,
        fit_side: bool = True,
        labels: str = "auto",
        depth: str = "pose_2",
        tilt: str = "pose_6",
        frames: str = "auto",
        split: str = "",
        range: str = "auto",  # noqa: A002 - what the parameter is called
        trust_labels: bool = False,
    ) -> None:
        if context.data is None:
            raise UserError(
                "sensor 'recorded' needs --data FOLDER, a folder that holds targets.csv and its "
                "frames, or a data set."
            )
        options = ImportOptions(
            frames=frames,
            depth=depth,
            tilt=tilt,
            offset_mm=depth_offset_mm,
            pivot_mm=pivot_mm,
            pivot_side_mm=pivot_side_mm,
        )
        given = (depth_offset_mm, pivot_mm, pivot_side_mm) != (OFFSET_MM, PIVOT_MM, 0.0)
        fit = labels == "fitted" or (labels == "auto" and context.indentation and not given)
        self._presses = open_presses(context.data, options, fit=fit, fit_side=fit_side, split=split)
        if not trust_labels:
            _refuse_contradictions(self._presses, fitted=fit)
        self._row = {scene: number for number, scene in enumerate(self._presses.scenes)}
        recording = self._recording
        self.signal = "channels" if isinstance(recording.kind, ChannelKind) else "image"
        states_radius = recording.dataset is not None or recording.header
        if recording.dome_radius_mm is not None and states_radius:
            self.dome_radius_mm = recording.dome_radius_mm
        if range != "published":
            radius = recording.dome_radius_mm
            self.workspace = own_workspace(self._presses.scenes, radius, always=range == "own")

    def scenes(self) -> dict[str, Scene]:
        """Return name of a frame -> scene, in the order of the table; no two scenes are equal."""
        return dict(zip(self._presses.names, self._presses.scenes, strict=True))

    def presses(self) -> dict[str, str]:
        """Return name of a frame -> name of its press, which frames of one press share."""
        return dict(zip(self._presses.names, self._presses.presses, strict=True))

    def split(self) -> Mapping[str, str]:
        """Return name of a frame -> subset of the split; {} without a split."""
        return self._presses.subsets

    def rest(self) -> Frame:
        """Return the undeformed sensor.

        Raises:
            UserError: The recording has no such frame.
        """
        if self._rest_signal is None:
            advice = "add one as init_0.png" if self.signal == "image" else "record one"
            raise UserError(
                f"{self._recording.frames} has no frame of the undeformed sensor; {advice}."
            )
        return Frame(self._rest_signal, -1.0, Pose(), self._rest_signal)

    def press(self, scene: Scene) -> Frame:
        """Return the frame of a scene.

        Raises:
            UserError: The scene was not recorded.
        """
        return self._frame(self._find(scene))

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Yield the frames of scenes in order; threads decode some ahead (which frees the GIL).

        Raises:
            UserError: A scene was not recorded.
        """
        waiting: deque[Future[Frame]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            try:
                for scene in scenes:
                    waiting.append(pool.submit(self._frame, self._find(scene)))
                    if len(waiting) >= _PREFETCH:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()

    def describe(self) -> dict[str, Any]:
        """Return the facts that determine the frames; the path of the folder is none of them."""
        recording, options = self._recording, self._presses.options
        rest = None if recording.rest is None else recording.rest.name
        if recording.estimated_rest is not None:
            rest = "estimated from the least pressed frames"
        if recording.dataset is not None and self._rest_signal is not None:
            rest = "rest"
        aside, fit = options.pivot_side_mm, self._presses.label_fit
        origin = {} if recording.dataset is None else recording.dataset.header.sensor
        return {
            "format": recording.format,
            "folder": recording.folder.resolve().name,
            "frames": recording.frames.name,
            "sha256": recording.sha256,
            **({"recorded_with": origin["name"]} if "name" in origin else {}),
            **({"origin": "simulated"} if origin.get("origin") == "simulated" else {}),
            "count": len(self._presses.scenes),
            **_described_kind(recording),
            "rest": rest,
            "columns": dict(self._presses.columns),
            "depth_offset_mm": float(options.offset_mm),
            "pivot_mm": float(options.pivot_mm),
            **({"pivot_side_mm": float(aside)} if aside else {}),
            **({} if fit is None else {"label_fit": _described(fit)}),
        }

    @property
    def _recording(self) -> Recording:
        return self._presses.recording

    @cached_property
    def _rest_signal(self) -> npt.NDArray[Any] | None:
        return self._recording.rest_signal()

    def _frame(self, number: int) -> Frame:
        signal = self._recording.signal(self._presses.rows[number])
        return Frame(signal, float(number), self._presses.scenes[number].pose, self._rest_signal)

    def _find(self, scene: Scene) -> int:
        number = self._row.get(scene)
        if number is None:
            raise UserError(_not_recorded(self._presses, scene))
        return number


def _refuse_contradictions(presses: RecordedPresses, *, fitted: bool) -> None:
    """Raise UserError where the frames contradict the labels, unless a fit has checked them."""
    if fitted and presses.label_fit is not None:
        return
    scenes: list[Scene | None] = [None] * len(presses.recording)
    for row, scene in zip(presses.rows, presses.scenes, strict=True):
        scenes[row] = scene
    wrong = cached_report(presses.recording, scenes, presses.options).contradictions
    if wrong:
        raise UserError(
            f"the frames of {presses.recording.folder} contradict the labels: {wrong[0]}. Correct "
            "the table or the parameters of the import; if the labels are right, run with --param "
            "sensor.trust_labels=yes, which the row will show."
        )


def _described_kind(recording: Recording) -> dict[str, Any]:
    """Return shape and kind of the frames' signal."""
    kind = recording.kind
    if isinstance(kind, ChannelKind):
        return {"signal": list(kind.shape), "names": list(recording.signal_names)}
    view = {} if recording.view is None else {"cut_out": str(recording.view)}
    return {"image": [kind.height, kind.width], "channels": recording.channels, **view}


def _described(fit: RecordingFit) -> dict[str, Any]:
    """Return what records say of the fit of the labels, beside its numbers."""
    pivot = fit.pivot
    return {
        "presses": pivot.presses,
        "left_out": pivot.left_out,
        "misfit": pivot.residual,
        "lean_deg": fit.lean_deg,
    }


def _not_recorded(presses: RecordedPresses, scene: Scene) -> str:
    poses, pose = [scene.pose for scene in presses.scenes], scene.pose
    depth, tilt = [pose.depth for pose in poses], [pose.tilt for pose in poses]
    kinds = indenter_names(presses.scenes)
    content = "plate presses" if kinds == ["plate"] else f"presses by {', '.join(kinds)}"
    return (
        f"{presses.recording.folder} is a recording of {len(poses):,} {content} "
        f"(depth {min(depth):.2f} to {max(depth):.2f} mm, tilt {min(tilt):.1f} to {max(tilt):.1f} "
        f"deg) and has no press of {scene.indenter.name!r} at x {pose.x:g} mm, y {pose.y:g} mm, "
        f"depth {pose.depth:g} mm, tilt {pose.tilt:g} deg; use it with a protocol that takes its "
        "own presses, as 'surface' does."
    )
