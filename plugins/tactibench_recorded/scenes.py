"""What was pressed in every frame of a recording, so that each frame can be asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tactibench import Scene, UserError
from tactibench.datasets.importing import (
    ImportOptions,
    Recording,
    indentation_options,
    open_recording,
    plate_scenes,
)


@dataclass(frozen=True, eq=False)
class Pressed:
    """Frames whose scene is known. names, scenes, presses, rows of the recording: of every frame.

    columns: role -> column that was read. options: what labels were read by. parts: name -> part of
    the split that was asked for; {} without one.
    """

    recording: Recording
    names: tuple[str, ...]
    scenes: tuple[Scene, ...]
    presses: tuple[str, ...]
    rows: tuple[int, ...]
    columns: Mapping[str, str]
    options: ImportOptions
    parts: Mapping[str, str]


def pressed(
    folder: Path, options: ImportOptions, *, fitted: bool = False, split: str = ""
) -> Pressed:
    """Open a folder; where no scene is known, its labels are a plate's. Raises UserError.

    fitted: take the labels' offset and pivot from the pins instead of ``options``. split: name of a
    split of a data set.
    """
    recording = open_recording(folder, ImportOptions(frames=options.frames))
    scenes, columns = recording.scenes, dict(recording.columns)
    if not any(scenes):
        if fitted:
            options = indentation_options(recording, options)
        scenes, roles = plate_scenes(recording, options)
        columns |= roles
    rows = tuple(row for row, scene in enumerate(scenes) if scene is not None)
    if not rows:
        raise UserError(f"{folder} has no frame of which it is known what was pressed.")
    return Pressed(
        recording,
        tuple(recording.names[row] for row in rows),
        _distinct(scene for scene in scenes if scene is not None),
        tuple(recording.presses[row] for row in rows),
        rows,
        columns,
        options,
        parts_of(recording, split) if split else {},
    )


def parts_of(recording: Recording, split: str) -> dict[str, str]:
    """Frame name -> part of the split of that name. Raises UserError where there is none."""
    found = {} if recording.dataset is None else recording.dataset.splits
    if split not in found:
        named = f"; it has {', '.join(found)}" if found else ""
        raise UserError(
            f"{recording.folder} has no splits/{split}.json{named}; leave --param sensor.split out "
            "to divide as the protocol says."
        )
    assert recording.dataset is not None  # noqa: S101 - it has splits
    part_of = found[split].subset_of()
    ids = [recording.dataset.samples[row].id for row in recording.rows]
    return {
        name: part_of[number]
        for name, number in zip(recording.names, ids, strict=True)
        if number in part_of
    }


def kinds_of(scenes: Iterable[Scene]) -> list[str]:
    """Names of the indenters, without the numbers that ``_distinct`` adds."""
    return sorted({scene.indenter.name.partition(" #")[0] for scene in scenes})


def _distinct(scenes: Iterable[Scene]) -> tuple[Scene, ...]:
    """A press that was made before gets an indenter named 'plate #2', 'plate #3' ..., so that every
    frame keeps a scene of its own and can be asked for."""
    seen: Counter[Scene] = Counter()
    found = []
    for scene in scenes:
        seen[scene] += 1
        name = f"{scene.indenter.name} #{seen[scene]}"
        again = seen[scene] > 1
        found.append(
            replace(scene, indenter=replace(scene.indenter, name=name)) if again else scene
        )
    return tuple(found)
