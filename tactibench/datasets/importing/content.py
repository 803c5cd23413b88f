"""The files of a recording, read once: are they sound and alike, and what is their hash."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactibench.errors import UserError
from tactibench.png import ImageKind, check_png, read_file

_BITS_AT, _MOST_BITS = 24, 8


@dataclass(frozen=True)
class Content:
    """kind: what every frame is. sha256: over the table, every frame and the rest frame."""

    kind: ImageKind
    sha256: str


def read_content(table: bytes, paths: Sequence[Path], rest: Path | None) -> Content:
    """Read every file once.

    Raises UserError for frames that are no sound PNG of 8 bits, or differ in size.
    """
    digest = hashlib.sha256(table)
    kind: ImageKind | None = None
    for path in (*paths, rest):
        if path is None:
            continue
        data = read_file(path)
        found = check_png(path, data)
        if data[_BITS_AT] > _MOST_BITS:
            raise UserError(
                f"{path} has {data[_BITS_AT]} bits a pixel; frames have 8: convert them first."
            )
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
    return Content(kind, digest.hexdigest())
