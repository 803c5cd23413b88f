"""The scenes of a recording's frames, by which a sensor finds the frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tactibench import Scene, UserError
from tactibench.datasets import (
    ImportOptions,
    Recording,
    RecordingFit,
    cached_fit,
    open_recording,
    plate_scenes,
)


@dataclass(frozen=True, eq=False)
class RecordedPresses:
    """Frames whose scene is known.

    Attributes:
        recording: The recording.
        names: Name of every frame.
        scenes: Scene of every frame; no two are equal.
        presses: Name of the press of every frame.
        rows: Row of the recording of every frame.
        columns: Role -> column that was read.
        options: Options by which labels were read.
        subsets: Name of a frame -> subset of the split that was asked for; empty without a split.
        label_fit: Fit of the labels' offset and pivot to the pins; None: they were not fitted.
    """

    recording: Recording
    names: tuple[str, ...]
    scenes: tuple[Scene, ...]
    presses: tuple[str, ...]
    rows: tuple[int, ...]
    columns: Mapping[str, str]
    options: ImportOptions
    subsets: Mapping[str, str]
    label_fit: RecordingFit | None = None


def open_presses(
    folder: Path,
    options: ImportOptions,
    *,
    fit: bool = False,
    fit_side: bool = True,
    split: str = "",
) -> RecordedPresses:
    """Open a folder; where it knows no scene, its labels are those of a plate.

    Args:
        folder: A recording of any format, or a data set.
        options: Folder of the frames, and how labels are read.
        fit: Whether to take the labels' offset and pivot from the pins instead.
        fit_side: Whether q is fitted, too; it is 0 otherwise.
        split: Name of a split of a data set.

    Raises:
        UserError: A file, the split or every known scene is missing, or a file is damaged.
    """
    recording = open_recording(folder, ImportOptions(frames=options.frames))
    scenes, columns = recording.scenes, dict(recording.columns)
    label_fit = None
    if not any(scenes):
        if fit:
            label_fit = cached_fit(recording, options, side=fit_side)
            pivot = label_fit.pivot
            options = replace(
                options,
                offset_mm=pivot.offset_mm,
                pivot_mm=pivot.pivot_mm,
                pivot_side_mm=pivot.side_mm,
            )
        scenes, roles = plate_scenes(recording, options)
        columns |= roles
    rows = tuple(row for row, scene in enumerate(scenes) if scene is not None)
    if not rows:
        raise UserError(f"{folder} has no frame of which it is known what was pressed.")
    return RecordedPresses(
        recording,
        tuple(recording.names[row] for row in rows),
        _number_repeated(scene for scene in scenes if scene is not None),
        tuple(recording.presses[row] for row in rows),
        rows,
        columns,
        options,
        _split_subsets(recording, split) if split else {},
        label_fit,
    )


def indenter_names(scenes: Iterable[Scene]) -> list[str]:
    """Return the names of the indenters, without the numbers of repeated presses."""
    return sorted({scene.indenter.name.partition(" #")[0] for scene in scenes})


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


def _number_repeated(scenes: Iterable[Scene]) -> tuple[Scene, ...]:
    """Return the scenes with the indenters of repeated presses named 'plate #2', 'plate #3' ....

    Every frame then has a scene of its own, by which it can be found.
    """
    times: Counter[Scene] = Counter()
    numbered = []
    for scene in scenes:
        times[scene] += 1
        if times[scene] > 1:
            name = f"{scene.indenter.name} #{times[scene]}"
            numbered.append(replace(scene, indenter=replace(scene.indenter, name=name)))
        else:
            numbered.append(scene)
    return tuple(numbered)
