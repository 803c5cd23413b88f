"""Published predictions for a protocol's test frames: where their files are, and their values.

They are read from files beside the data, which are no part of tactibench.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, PlatePose
from tactibench.errors import UserError
from tactibench.protocols import LoadedProtocol, ReleasedAnswers, load_published, rows_for
from tactibench.records import file_hash, pack_plates
from tactibench.run.score import PUBLISHED

Arrays = dict[str, npt.NDArray[Any]]

_PARENTS = 2
"""Number of folders above --data that are searched: --data may name a recording or a folder inside
it."""
_TOLERANCE_DEG = 1e-3
"""Largest difference of tilts from those of the folder, deg: published labels are rounded."""


@dataclass(frozen=True)
class PublishedPredictions:
    """Predictions of a model for the test frames, row by row.

    Attributes:
        table: Name of the published table.
        model: Name of the model in the paper.
        file: Name, hash and columns of the file.
        path: Path of the file; None where it was not found.
    """

    table: str
    model: str
    file: ReleasedAnswers
    path: Path | None

    @property
    def identity(self) -> dict[str, Any]:
        """Return what determines the comparison."""
        return {"table": self.table, **self.file.model_dump(mode="json")}

    def describe(self) -> str:
        """Return the text that a plan shows for these predictions."""
        name = f"the released answers of {self.model}"
        if self.path is not None:
            return f"{name}, frame for frame"
        return (
            f"nothing: {self.file.file}, {name}, is not beside the data; name it with "
            "--published FILE to compare frame for frame"
        )


def find_published(
    protocol: LoadedProtocol, data: Path | None, given: Path | None
) -> tuple[PublishedPredictions, ...]:
    """Return the predictions of the protocol's published tables.

    Args:
        protocol: The protocol, which names the tables.
        data: Folder beside which the files are sought.
        given: A file to take instead; None to search.

    Raises:
        UserError: The given file cannot be read, or is no file that was published for the protocol.
    """
    tables = load_published(protocol.spec.published.tables)
    rows = [
        (table.name, row.model, row.released)
        for table in tables
        for row in rows_for(protocol.spec.id, table)
        if row.released is not None
    ]
    if given is not None:
        _check_given(given, rows, protocol.spec.id)
        paths = [given]
    else:
        places = [] if data is None else [data, *data.resolve().parents[:_PARENTS]]
        paths = [place / file.file for _, _, file in rows for place in places]
    hashes = {path: _hash(path) for path in paths}
    return tuple(
        PublishedPredictions(
            table,
            model,
            file,
            next((path for path, digest in hashes.items() if digest == file.sha256), None),
        )
        for table, model, file in rows
    )


def published_arrays(
    published: Sequence[PublishedPredictions],
    names: Sequence[str],
    pressed: Sequence[str],
    truth: Sequence[Answer],
) -> Arrays:
    """Return packed predictions for test frames, named ``released.<table>.<array>``.

    A published prediction is shifted by the difference between the truth and its label (a sensor
    may count depth from elsewhere), so its error stays the same.

    Args:
        published: Published predictions; those whose file was not found are left out.
        names: Names of the published test frames, in the order of the file.
        pressed: Names of the test frames of the run.
        truth: True answers to the test frames of the run.

    Raises:
        UserError: A file has not one row for every name, a column holds something else than finite
            numbers, or the tilts are not those of the frames.
    """
    arrays: Arrays = {}
    for predictions in published:
        if predictions.path is not None:
            poses = _poses(predictions.path, predictions.file, names, pressed, truth)
            for name, array in pack_plates(poses).items():
                arrays[f"{PUBLISHED}{predictions.table}.{name}"] = array
    return arrays


def _check_given(
    path: Path, rows: Sequence[tuple[str, str, ReleasedAnswers]], protocol: str
) -> None:
    digest = _hash(path)
    if digest is None:
        raise UserError(f"--published {path} cannot be read; name the file of answers.")
    if all(file.sha256 != digest for _, _, file in rows):
        names = ", ".join(f"{file.file} ({model})" for _, model, file in rows) or "none"
        raise UserError(
            f"--published {path} is not a file that was released for protocol {protocol!r} "
            f"(sha256 {digest[:12]}); released: {names}."
        )


def _poses(
    path: Path,
    file: ReleasedAnswers,
    names: Sequence[str],
    pressed: Sequence[str],
    truth: Sequence[Answer],
) -> list[PlatePose]:
    depth, tilt = (read_columns(path, pair) for pair in (file.depth, file.tilt))
    if len(depth) != len(names):
        raise UserError(f"{path} has {len(depth):,} rows for {len(names):,} test frames.")
    row_of = {name: row for row, name in enumerate(names)}
    order = [row_of[name] for name in pressed]
    poses = [answer for answer in truth if isinstance(answer, PlatePose)]
    true = np.array([[pose.depth, pose.tilt] for pose in poses])
    label = np.column_stack([depth[order, 1], tilt[order, 1]])
    gap = float(np.abs(true[:, 1] - label[:, 1]).max())
    if gap > _TOLERANCE_DEG:
        raise UserError(
            f"{path} holds answers to other tilts than those of the test frames ({gap:.2g} "
            "deg apart); take the tilts as they were recorded, or move the file away."
        )
    answers = np.column_stack([depth[order, 0], tilt[order, 0]]) + (true - label)
    return [PlatePose(float(d), float(t)) for d, t in answers]


def read_columns(path: Path, names: Sequence[str]) -> npt.NDArray[np.float64]:
    """Return columns of numbers from a CSV file.

    Args:
        path: The file. A cell is a number or ``tensor(number)``.
        names: Names of C columns.

    Returns:
        (N, C) numbers.

    Raises:
        UserError: The file has no rows, or a cell of the columns holds no finite number.
    """
    import pandas as pd

    table = pd.read_csv(path, dtype=str, encoding="utf-8-sig").reindex(columns=list(names))
    try:
        values = table.replace(r"tensor\((.*)\)", r"\1", regex=True).to_numpy(np.float64)
    except ValueError:
        values = np.full((1, len(names)), np.nan)
    if not len(values) or not np.isfinite(values).all():
        raise UserError(f"{path}: the columns {' and '.join(names)} must hold finite numbers.")
    return values


def _hash(path: Path) -> str | None:
    try:
        return file_hash(path) if path.is_file() else None
    except OSError:
        return None
