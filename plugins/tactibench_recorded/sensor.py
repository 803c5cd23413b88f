"""A recording as a sensor: it answers the presses that it has."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy.typing as npt

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError
from tactibench.datasets import (
    ChannelKind,
    ImportOptions,
    Recording,
    RecordingFit,
    cached_fit,
    cached_report,
    open_recording,
    own_workspace,
)

_THREADS = min(8, os.cpu_count() or 1)
_PREFETCH = 8 * _THREADS
"""Frames that are decoded ahead: enough for all threads, few enough for any memory."""
OFFSET_MM, PIVOT_MM = 5.0, 0.0
"""Offset and pivot of labels where no parameter gives them. In the Tac-VGNN recordings the labelled
pose is about 5 mm from first touch; the offset moves all depths of a recording alike."""


class RecordedSensor(Sensor):
    """A sensor that answers the presses of a folder of recorded frames.

    The folder is of the Bristol convention, has a CSV file, or is a data set. Scenes that it knows
    (data sets, tables with x_mm, y_mm and depth_mm) are taken as they are. Other labels are read as
    a plate's: depth = depth label + ``depth_offset_mm`` + ``pivot_mm`` (1 - cos tilt) +
    ``pivot_side_mm`` sin tilt, tilt = tilt label. Everything is checked when the sensor is built.
    Frames without a scene are left out.

    Args:
        context: Circumstances of the run, with the folder in ``context.data``; ``hooks.py`` tells
            of the other parameters.

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
        labels: str = "auto",
        depth: str = "pose_2",
        tilt: str = "pose_6",
        split: str = "",
        range: str = "auto",  # noqa: A002 - what the parameter is called
        trust_labels: bool = False,
        light: str = "auto",
    ) -> None:
        if context.data is None:
            raise UserError(
                "sensor 'recorded' needs --data FOLDER, a folder that holds targets.csv and its "
                "frames, or a data set."
            )
        options = ImportOptions(
            depth=depth,
            tilt=tilt,
            offset_mm=depth_offset_mm,
            pivot_mm=pivot_mm,
            pivot_side_mm=pivot_side_mm,
        )
        given = (depth_offset_mm, pivot_mm, pivot_side_mm) != (OFFSET_MM, PIVOT_MM, 0.0)
        fit = labels == "fitted" or (labels == "auto" and context.indentation and not given)
        recording = open_recording(context.data, ImportOptions(light=light))
        self._recording, self._options = recording, options
        self._columns = dict(recording.columns)
        self._label_fit: RecordingFit | None = None
        scenes: Sequence[Scene | None] = recording.scenes
        if recording.sites:
            scenes = recording.site_scenes()
        if not any(scenes):
            scenes = self._read_plates(fit=fit)
        self._rows = tuple(row for row, scene in enumerate(scenes) if scene is not None)
        if not self._rows:
            raise UserError(f"{context.data} has no frame of which it is known what was pressed.")
        self._scenes = tuple(scene for scene in scenes if scene is not None)
        self._split = _split_subsets(recording, split) if split else {}
        if not (trust_labels or self._label_fit or recording.sites):  # a fit has checked them
            self._refuse_contradictions()
        self.signal = "channels" if isinstance(recording.kind, ChannelKind) else "image"
        if recording.dome_radius_mm is not None and recording.dataset is not None:
            self.dome_radius_mm = recording.dome_radius_mm
        if range != "published":
            radius = recording.dome_radius_mm
            self.workspace = own_workspace(self._scenes, radius, always=range == "own")

    def scenes(self) -> dict[str, Scene]:
        """Return name of a frame -> scene, in the order of the table."""
        return dict(zip(self._of_frames(self._recording.names), self._scenes, strict=True))

    def presses(self) -> dict[str, str]:
        """Return name of a frame -> name of its press, which frames of one press share."""
        names, presses = self._recording.names, self._recording.presses
        return dict(zip(self._of_frames(names), self._of_frames(presses), strict=True))

    def sessions(self) -> dict[str, str]:
        """Return name of a frame -> session; {} where no session is known."""
        names, sessions = self._recording.names, self._recording.sessions
        if not any(sessions):
            return {}
        return dict(zip(self._of_frames(names), self._of_frames(sessions), strict=True))

    def split(self) -> Mapping[str, str]:
        """Return name of a frame -> subset of the split; {} without a split."""
        return self._split

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
        """Return the first frame of a scene.

        Raises:
            UserError: The scene was not recorded.
        """
        if scene not in self._scenes:
            kinds = sorted({recorded.indenter.name for recorded in self._scenes})
            raise UserError(
                f"{self._recording.folder} is a recording of {len(self._scenes):,} presses by "
                f"{', '.join(kinds)} and has none by {scene.indenter.name!r} at this pose; use it "
                "with a protocol that takes its own presses, as 'surface' does."
            )
        return self._frame(self._scenes.index(scene))

    def frames(self, names: Iterable[str]) -> Iterator[Frame]:
        """Yield the frames of these names; threads decode some ahead (which frees the GIL)."""
        number_of = {name: number for number, name in enumerate(self.scenes())}
        waiting: deque[Future[Frame]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            try:
                for name in names:
                    waiting.append(pool.submit(self._frame, number_of[name]))
                    if len(waiting) >= _PREFETCH:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()

    def describe(self) -> dict[str, Any]:
        """Return the facts that determine the frames; the path of the folder is none of them."""
        recording, options = self._recording, self._options
        aside, fit = options.pivot_side_mm, self._label_fit
        origin = {} if recording.dataset is None else recording.dataset.header.sensor
        return {
            "format": recording.format,
            "folder": recording.folder.resolve().name,
            "frames": recording.frames.name,
            "sha256": recording.sha256,
            **({"recorded_with": origin["name"]} if "name" in origin else {}),
            **({"origin": "simulated"} if origin.get("origin") == "simulated" else {}),
            "count": len(self._scenes),
            **_described_kind(recording),
            "rest": recording.rest_name,
            "columns": dict(self._columns),
            "depth_offset_mm": float(options.offset_mm),
            "pivot_mm": float(options.pivot_mm),
            **({"pivot_side_mm": float(aside)} if aside else {}),
            **({} if fit is None else {"label_fit": _described(fit)}),
        }

    @cached_property
    def _rest_signal(self) -> npt.NDArray[Any] | None:
        return self._recording.rest_signal()

    def _frame(self, number: int) -> Frame:
        row, pose = self._rows[number], self._scenes[number].pose
        signal, force = self._recording.signal(row), self._recording.force(row)
        session = self._recording.sessions[row] if self._recording.sessions else ""
        return Frame(signal, float(number), pose, self._rest_signal, force, session)

    def _of_frames(self, values: Sequence[str]) -> list[str]:
        """Return what the frames with a scene have, of the values of all rows."""
        return [values[row] for row in self._rows]

    def _read_plates(self, *, fit: bool) -> Sequence[Scene]:
        """Return the scenes of labels that are a plate's; columns and options become those read.

        Args:
            fit: Whether to take the labels' offset and pivot from the pins instead.
        """
        if fit:
            self._label_fit = cached_fit(self._recording, self._options)
            pivot = self._label_fit.pivot
            self._options = replace(
                self._options,
                offset_mm=pivot.offset_mm,
                pivot_mm=pivot.pivot_mm,
                pivot_side_mm=pivot.side_mm,
            )
        scenes, roles = self._recording.plate_scenes(self._options)
        self._columns |= roles
        return scenes

    def _refuse_contradictions(self) -> None:
        """Raise UserError where the frames contradict the labels."""
        scenes: list[Scene | None] = [None] * len(self._recording)
        for row, scene in zip(self._rows, self._scenes, strict=True):
            scenes[row] = scene
        wrong = cached_report(self._recording, scenes, self._options).contradictions
        if wrong:
            raise UserError(
                f"the frames of {self._recording.folder} contradict the labels: {wrong[0]}. "
                "Correct the table or the parameters of the import; if the labels are right, run "
                "with --param sensor.trust_labels=yes, which the row will show."
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


def _split_subsets(recording: Recording, name: str) -> dict[str, str]:
    """Return name of a frame -> subset of the split of that name.

    Raises:
        UserError: The recording has no such split.
    """
    splits = {} if recording.dataset is None else recording.dataset.splits
    if recording.dataset is None or name not in splits:
        others = f"; it has {', '.join(splits)}" if splits else ""
        raise UserError(
            f"{recording.folder} has no splits/{name}.json{others}; leave --param sensor.split out "
            "to divide as the protocol says."
        )
    subset_of = splits[name].subset_of()
    ids = [recording.dataset.samples[row].id for row in recording.rows]
    return {
        frame: subset_of[number]
        for frame, number in zip(recording.names, ids, strict=True)
        if number in subset_of
    }
