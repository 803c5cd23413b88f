"""Answers that somebody released to a protocol's test frames: where they are, and what they say.

They are read where they ship, beside the data, and never travel with tactibench.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.board.published import ReleasedAnswers, load_published, rows_for
from tactibench.contacts import Answer, PlatePose
from tactibench.errors import UserError
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.answers import pack_plates, unpack_plates
from tactibench.records.files import file_hash
from tactibench.shipped import shipped_folder

Arrays = dict[str, npt.NDArray[Any]]

_PARENTS = 2
"""So many folders above --data are searched: it may name a recording or a folder inside it."""
_TOLERANCE = 1e-3
"""Released labels are rounded: deg by which they may differ from those of the folder."""
_CELL = re.compile(r"(?:tensor\()?([^()]*)\)?")
PREFIX = "released."


@dataclass(frozen=True)
class Released:
    """Answers of a model to the test frames, row by row. path: None where they were not found."""

    table: str
    model: str
    keys: ReleasedAnswers
    path: Path | None

    @property
    def identity(self) -> dict[str, Any]:
        """What determines the comparison."""
        return {"table": self.table, **self.keys.model_dump(mode="json")}

    def words(self) -> str:
        """What a plan says of it."""
        what = f"the released answers of {self.model}"
        if self.path is not None:
            return f"{what}, frame for frame"
        return (
            f"nothing: {self.keys.file}, {what}, is not beside the data; name it with "
            "--published FILE to compare frame for frame"
        )


def find_released(
    protocol: LoadedProtocol, data: Path | None, given: Path | None
) -> tuple[Released, ...]:
    """Released answers of the protocol's published tables, looked for beside the data.

    given: a file to take instead. Raises UserError when it is not one of those that were released.
    """
    tables = load_published(protocol.keys.published.tables, shipped_folder("published"))
    rows = [
        (table.name, row.model, row.released)
        for table in tables
        for row in rows_for(protocol.keys.id, table)
        if row.released is not None
    ]
    if given is not None:
        found = _hash(given)
        if found is None:
            raise UserError(f"--published {given} cannot be read; name the file of answers.")
        if all(keys.sha256 != found for _, _, keys in rows):
            names = ", ".join(f"{keys.file} ({model})" for _, model, keys in rows) or "none"
            raise UserError(
                f"--published {given} is not a file that was released for protocol "
                f"{protocol.keys.id!r} (sha256 {found[:12]}); released: {names}."
            )
    places = [] if data is None else [data, *data.resolve().parents[:_PARENTS]]
    paths = [place / keys.file for _, _, keys in rows for place in places]
    if given is not None:
        paths = [given]
    hashes = {path: _hash(path) for path in paths}
    return tuple(
        Released(
            table,
            model,
            keys,
            next((path for path, found in hashes.items() if found == keys.sha256), None),
        )
        for table, model, keys in rows
    )


def released_arrays(
    released: Sequence[Released],
    names: Sequence[str],
    pressed: Sequence[str],
    truth: Sequence[Answer],
) -> Arrays:
    """Packed answers to the frames ``pressed``, named ``released.<table>.<array>``.

    names: of the rows. A released answer is moved by what its label differs from the truth (a
    sensor may count depth from elsewhere): its error stays. Raises UserError for a file that is not
    one row a name, or whose tilts are not those of the frames.
    """
    arrays: Arrays = {}
    for one in released:
        if one.path is None:
            continue
        answers = _aligned(one, names, pressed, truth)
        packed = pack_plates(answers)
        arrays |= {f"{PREFIX}{one.table}.{name}": array for name, array in packed.items()}
    return arrays


def unpack_released(
    arrays: Mapping[str, npt.NDArray[Any]],
) -> dict[str, tuple[PlatePose | None, ...]]:
    """By table; the inverse of the above."""
    tables: dict[str, Arrays] = {}
    for key, array in arrays.items():
        if key.startswith(PREFIX):
            table, _, name = key.removeprefix(PREFIX).rpartition(".")
            tables.setdefault(table, {})[name] = array
    return {table: unpack_plates(packed) for table, packed in tables.items()}


def _aligned(
    one: Released, names: Sequence[str], pressed: Sequence[str], truth: Sequence[Answer]
) -> list[PlatePose]:
    assert one.path is not None  # noqa: S101 - the caller looked
    depth, tilt = (_columns(one.path, pair) for pair in (one.keys.depth, one.keys.tilt))
    if len(depth) != len(names):
        raise UserError(f"{one.path} has {len(depth):,} rows for {len(names):,} test frames.")
    row = {name: k for k, name in enumerate(names)}
    order = [row[name] for name in pressed]
    poses = [answer for answer in truth if isinstance(answer, PlatePose)]
    true = np.array([[pose.depth, pose.tilt] for pose in poses])
    label = np.column_stack([depth[order, 1], tilt[order, 1]])
    apart = float(np.abs(true[:, 1] - label[:, 1]).max())
    if apart > _TOLERANCE:
        raise UserError(
            f"{one.path} holds answers to other tilts than those of the test frames ({apart:.2g} "
            "deg apart); take the tilts as they were recorded, or move the file away."
        )
    answers = np.column_stack([depth[order, 0], tilt[order, 0]]) + (true - label)
    return [PlatePose(float(d), float(t)) for d, t in answers]


def _columns(path: Path, names: Sequence[str]) -> npt.NDArray[np.float64]:
    """(N, 2) answers and labels; a cell is a number or ``tensor(number)``."""
    with path.open(newline="", encoding="utf-8-sig") as stream:
        rows = list(csv.DictReader(stream))
    cells = [[_CELL.fullmatch((row.get(name) or "").strip()) for name in names] for row in rows]
    try:
        values = np.array([[float(cell[1]) if cell else np.nan for cell in row] for row in cells])
    except ValueError:
        values = np.full((1, len(names)), np.nan)
    if not len(values) or not np.isfinite(values).all():
        raise UserError(f"{path}: the columns {' and '.join(names)} must hold finite numbers.")
    return values


def _hash(path: Path) -> str | None:
    try:
        return file_hash(path)
    except OSError:
        return None
