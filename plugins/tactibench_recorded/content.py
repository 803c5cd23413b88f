"""The files of a recording, read once: are they all there and sound, and what is their hash."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactibench import UserError
from tactibench_recorded.layout import Layout
from tactibench_recorded.png import ImageKind, check_png, read_file


@dataclass(frozen=True)
class Content:
    """paths: of the frames, in file order. rest: of the undeformed frame, if there is one.
    kind: what every frame is. sha256: over targets.csv, every frame and the rest frame."""

    paths: tuple[Path, ...]
    rest: Path | None
    kind: ImageKind
    sha256: str


def read_content(layout: Layout, targets: bytes, names: Sequence[str]) -> Content:
    """Read every file once.

    Raises UserError for frames that are not files, are no sound PNG, or differ in size.
    """
    paths = _paths(layout, names)
    rest = _rest(layout.frames, set(paths))
    digest = hashlib.sha256(targets)
    kind: ImageKind | None = None
    for path in (*paths, rest):
        if path is None:
            continue
        data = read_file(path)
        found = check_png(path, data)
        kind = kind or found
        if found != kind:
            raise UserError(
                f"{path} is {found}, but {paths[0].name} is {kind}; "
                "all frames of a recording, the rest frame included, must be alike."
            )
        # the length keeps two files from passing for one
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    assert kind is not None, "labels have at least one row"  # noqa: S101
    return Content(paths, rest, kind, digest.hexdigest())


def _paths(layout: Layout, names: Sequence[str]) -> tuple[Path, ...]:
    """Names are relative to the frames folder, or (older recordings) to the one above it."""
    paths, missing = [], []
    for name in names:
        path = layout.frames / name
        if not path.is_file():
            path = layout.folder / name
        if not path.is_file():
            missing.append(name)
        paths.append(path)
    if missing:
        raise UserError(
            f"{layout.targets} names {len(missing)} frame{'s' if len(missing) > 1 else ''} that "
            f"{'are' if len(missing) > 1 else 'is'} not in {layout.frames}, first {missing[0]}; "
            "add the files or remove their rows."
        )
    return tuple(paths)


def _rest(frames: Path, listed: set[Path]) -> Path | None:
    """init_0.png, another *init*.png, or the image_0.png of newer recordings."""
    candidates = [frames / "init_0.png", *sorted(frames.glob("*init*.png")), frames / "image_0.png"]
    return next((path for path in candidates if path.is_file() and path not in listed), None)
