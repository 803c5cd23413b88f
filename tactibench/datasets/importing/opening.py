"""Which format a folder has, and reading it."""

from __future__ import annotations

from pathlib import Path

from tactibench.datasets import is_dataset
from tactibench.datasets.importing.assemble import assemble
from tactibench.datasets.importing.bristol import TARGETS, read_bristol, targets_of
from tactibench.datasets.importing.huggingface import read_huggingface, tables_of
from tactibench.datasets.importing.options import ImportOptions
from tactibench.datasets.importing.plain import read_plain
from tactibench.datasets.importing.recording import Recording
from tactibench.datasets.importing.stored import read_stored
from tactibench.errors import UserError, did_you_mean

BRISTOL, HUGGINGFACE, PLAIN, V1 = "bristol", "huggingface", "csv", "v1"
_READERS = {BRISTOL: read_bristol, HUGGINGFACE: read_huggingface, PLAIN: read_plain}
FORMATS = tuple(_READERS)
"""What can be imported."""


def find_format(folder: Path) -> str:
    """The format of a folder: "v1" or one of FORMATS. Raises UserError for a folder of none."""
    _check_folder(folder)
    if is_dataset(folder):
        return V1
    if targets_of(folder) or _inner(folder):
        return BRISTOL
    if tables_of(folder):
        return HUGGINGFACE
    if any(folder.glob("*.csv")):
        return PLAIN
    raise UserError(
        f"{folder} holds no {TARGETS[0]}, nor does any folder directly in it, and neither a "
        "dataset.json, a metadata.jsonl nor another CSV file; name a folder of recorded frames."
    )


def open_recording(
    folder: Path,
    options: ImportOptions | None = None,
    format: str | None = None,  # noqa: A002
) -> Recording:
    """Read the labels of a folder and check all its files.

    Of a v1 data set the options are not looked at. Raises UserError, naming file and row.
    """
    options = options or ImportOptions()
    found = format or find_format(folder)
    _check_folder(folder)
    if found == V1:
        return read_stored(folder)
    if found not in _READERS:
        raise UserError(f"there is no format {found!r}; {did_you_mean(found, FORMATS)}")
    if found == BRISTOL and not (options.table or targets_of(folder)):
        folder = _only(folder, _inner(folder))
    return assemble(_READERS[found](folder, options), options)


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise UserError(f"{folder} does not exist; give a folder of recorded frames.")
    if not folder.is_dir():
        raise UserError(f"{folder} is a file; give the folder that holds it.")
    try:
        next(folder.iterdir(), None)
    except OSError as error:
        raise UserError(f"{folder} cannot be listed: {error.strerror}.") from None


def _inner(folder: Path) -> list[Path]:
    """Recordings directly in a folder."""
    return sorted(child for child in folder.iterdir() if child.is_dir() and targets_of(child))


def _only(folder: Path, found: list[Path]) -> Path:
    if not found:
        raise UserError(f"{folder} holds no {TARGETS[0]}, nor does any folder directly in it.")
    if len(found) > 1:
        names = ", ".join(child.name for child in found)
        raise UserError(f"{folder} holds several recordings ({names}); give one of them.")
    return found[0]
