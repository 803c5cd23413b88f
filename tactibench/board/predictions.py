"""Predictions beside a committed record: ``<name>.npz``, lossless, and their checks.

The file holds the packed predictions as they were stored, and under ``ranked.`` the error that
orders the board, press by press, so that a board ranks its rows without making any truth again.
``tactibench board verify`` computes both anew. Files of strangers are read too: the number, sizes
and types of arrays are checked before anything is unpacked, and values before a metric reads them.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics import PlateTrials, Trials, press_shares
from tactibench.protocols import Protocol, board_spec
from tactibench.run import FAILURE_COLUMNS as FAILURES
from tactibench.run import LONGEST_CAUSE, trials_of

Arrays = dict[str, npt.NDArray[Any]]

RANKED = "ranked."
LARGEST = 64 * 2**20
"""Most bytes of all arrays of a file, unpacked; exp3 needs a third of a megabyte."""
LARGEST_PACKED = 8 * 2**20
"""Most bytes of a file; the largest committed one has 550 kB."""
MOST_ARRAYS = 16
"""Most arrays of a file. One holds five of answers, three of failures, and for each of three tests
two to rank by."""
LONGEST_TEXT = 200
"""Most characters of a text in an array: a cause, or the name of a press."""
DIRECTORY = 256
"""Bytes that an archive's directory takes for an array, with room to spare; numpy's takes 127."""
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Packings that are read. Others may need gigabytes of memory before they unpack a byte."""
ARRAY_NAME = re.compile(r"[a-z_.]{1,40}\.npy")


@dataclass(frozen=True, eq=False)
class PressErrors:
    """The error that orders a board, press by press.

    Attributes:
        press: (P,) names, sorted.
        error: (P,) errors, whose mean is the error of the board: of each press the sum over its
            frames, over the mean number of frames of a press.
        apart: The same for tests that are scored apart and have a ranking, by name of the test.
    """

    press: npt.NDArray[Any]
    error: FloatArray
    apart: Mapping[str, PressErrors] = field(default_factory=dict)


def answers_file(record_file: Path) -> Path:
    """Return the file of the predictions of a committed record."""
    return record_file.with_suffix(".npz")


def ranked_errors(
    spec: Protocol, truth: Mapping[str, npt.NDArray[Any]], predicted: Arrays
) -> Arrays:
    """Return the errors that order the board, as arrays of a file; empty where no error does."""
    if board_spec(spec.label).ranking is None:
        return {}
    errors = press_errors_of(spec, truth, predicted)
    arrays = {"press": errors.press, "error": errors.error}
    for name, test_errors in errors.apart.items():
        arrays |= {f"{name}.press": test_errors.press, f"{name}.error": test_errors.error}
    return {f"{RANKED}{name}": array for name, array in arrays.items()}


def press_errors_of(
    spec: Protocol, truth: Mapping[str, npt.NDArray[Any]], predicted: Arrays
) -> PressErrors:
    """Return the errors that order the board of a protocol.

    Args:
        spec: The protocol.
        truth: Packed truth of the test frames.
        predicted: Packed predictions.

    Raises:
        UserError: No error orders the board.
    """
    board = board_spec(spec.label)
    if board.ranking is None:
        raise UserError(f"no error orders the board of {spec.id}, so it ranks nothing.")
    apart = {}
    for test in spec.test.apart:
        trials = trials_of(spec, truth, predicted, apart=test)
        if len(trials) and (by := board.apart.get(test.name)):
            apart[test.name] = _press_errors(by.metric, "all", trials)
    group = board.ranking.group if spec.answer == "plate" else "all"  # elsewhere an axis, or all
    trials = trials_of(spec, truth, predicted)
    return replace(_press_errors(board.ranking.metric, group, trials), apart=apart)


def _press_errors(metric: str, group: str, trials: Trials | PlateTrials) -> PressErrors:
    error = press_shares(metric, trials, group)
    finite = np.isfinite(error)
    return PressErrors(np.unique(trials.press)[finite], error[finite])


def split_ranked(arrays: Arrays) -> tuple[Arrays, Arrays]:
    """Return the packed answers, and the arrays whose names begin with ``ranked.``."""
    ranked = {name: array for name, array in arrays.items() if name.startswith(RANKED)}
    return {name: array for name, array in arrays.items() if name not in ranked}, ranked


def read_answers_file(path: Path) -> Arrays:
    """Read all arrays of a file.

    Raises:
        UserError: The file is missing, damaged or too large, or holds other arrays than tactibench
            writes.
    """
    return _read_checked(path)


def read_press_errors(path: Path) -> PressErrors | None:
    """Return the errors that a board ranks by, read from the file of the predictions.

    None where the file is missing, or holds no errors to rank by.

    Raises:
        UserError: The file is damaged.
    """
    if not path.is_file():
        return None
    _, arrays = split_ranked(_read_checked(path, RANKED))
    tests = {name.removeprefix(RANKED).rpartition(".")[0] for name in arrays}
    read = {test: _read_test(arrays, f"{RANKED}{test}{'.' * bool(test)}", path) for test in tests}
    main = read.pop("", None)
    return None if main is None else replace(main, apart=read)


def _read_test(arrays: Arrays, begin: str, path: Path) -> PressErrors:
    """Return the errors of one test.

    Args:
        arrays: Arrays of the file.
        begin: Text that the names of the test's arrays begin with.
        path: File, for messages.

    Raises:
        UserError: The arrays do not hold one finite error a press, sorted by press.
    """
    press, errors = (arrays.get(f"{begin}{name}", np.empty(0)) for name in ("press", "error"))
    fitting = press.dtype.kind == "U" and errors.dtype.kind == "f" and errors.ndim == 1
    if not fitting or press.shape != errors.shape or not np.isfinite(errors).all():
        raise UserError(f"{path} does not hold one finite error a press; submit the run again.")
    if not (press[1:] > press[:-1]).all():
        raise UserError(
            f"{path} holds errors of presses that are not in order, each once; submit the run "
            "again."
        )
    return PressErrors(press, errors)


def _read_checked(path: Path, begin: str = "") -> Arrays:
    """Return the arrays of an archive whose names begin with a text, after checks.

    The number of members, their sizes in the archive's directory, and every array's own header are
    checked before memory is taken.
    """
    if path.is_symlink() or not path.is_file():
        raise UserError(f"{path} is missing: the answers belong beside the record.")
    if (packed := path.stat().st_size) > LARGEST_PACKED:
        raise UserError(
            f"{path} has {packed:,} bytes, more than the {LARGEST_PACKED:,} that answers may take; "
            "submit the answers to the test frames alone."
        )
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _refuse_members(members, path)
            expected = sum(member.compress_size + DIRECTORY for member in members)
            if packed > expected or min(member.header_offset for member in members):
                raise UserError(f"{path} holds more than its arrays; submit the run again.")
            names = [member.filename.removesuffix(".npy") for member in members]
            return {
                name: _read_array(archive, member, f"{path}: array {name!r}")
                for name, member in zip(names, members, strict=True)
                if name.startswith(begin)
            }
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - what zip, zlib, tokenizer and parser raise
        raise UserError(
            f"{path} is no archive of arrays ({type(error).__name__}); submit the run again."
        ) from None


def _refuse_members(members: list[zipfile.ZipInfo], path: Path) -> None:
    if len(members) > MOST_ARRAYS:
        raise UserError(
            f"{path} holds {len(members):,} arrays, more than the {MOST_ARRAYS} that answers may "
            "take; submit the answers to the test frames alone."
        )
    names = [member.filename for member in members]
    if len(set(names)) < len(names) or not all(map(ARRAY_NAME.fullmatch, names)):
        raise UserError(f"{path} holds a member that is no array, or two of one name.")
    if any(member.compress_type not in PACKINGS for member in members):
        raise UserError(f"{path} is packed in another way than tactibench packs arrays.")
    _refuse_bytes(sum(member.file_size for member in members), path)


def _refuse_bytes(count: int, what: object) -> None:
    if count > LARGEST:
        raise UserError(
            f"{what} holds {count:,} bytes of arrays, more than the {LARGEST:,} that answers may "
            "take; submit the answers to the test frames alone."
        )


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, what: str) -> npt.NDArray[Any]:
    """Return an array of a type and size that tactibench writes.

    Raises:
        UserError: Its format, type, shape or size is not one that tactibench writes.
        Exception: The data are damaged; any error of zip, zlib and the parsers.
    """
    with archive.open(member) as stream:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise UserError(f"{what} is written in another format than tactibench writes.")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        text = dtype.kind == "U" and 0 < dtype.itemsize <= 4 * LONGEST_TEXT
        plain = dtype.names is None and dtype.subdtype is None and dtype.isnative
        if not plain or not (text or dtype.str[1:] in ("i8", "f8", "b1")):
            raise UserError(
                f"{what} has type {dtype}, which is not how answers are stored; submit the run "
                "with `tactibench board submit`."
            )
        if len(shape) not in (1, 2) or any(type(n) is not int or n < 0 for n in shape):
            raise UserError(
                f"{what} has type {dtype} and shape {shape}, which is not how answers are stored; "
                "submit the run with `tactibench board submit`."
            )
        size = prod(shape) * dtype.itemsize
        _refuse_bytes(size, what)
        header = stream.tell()
        data = stream.read(size + 1)
    if len(data) != size or member.file_size != header + size:
        raise UserError(f"{what} has another number of bytes than its shape asks for, {size:,}.")
    if dtype.kind == "b" and np.frombuffer(data, np.uint8).max(initial=0) > 1:
        raise UserError(f"{what} holds truth values that are neither 0 nor 1.")
    if text:
        np.frombuffer(data, dtype).tolist()  # raises for what is no character
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C").copy()


MOST = 64
"""Most contacts in a frame; no protocol presses more than three."""
FARTHEST = 1e6
"""Largest value of an answer, mm (a kilometre) or deg: larger ones would overflow when squared."""
SMALLEST_STD = 1e-9
"""Smallest standard deviation, mm or deg; an error is divided by it and squared."""
CONTACTS = {
    "count": ("i", ()),
    "xy": ("f", (2,)),
    "depth": ("f", ()),
    "score": ("f", ()),
    "std": ("f", (3,)),
}
PLATES = {
    "given": ("b", ()),
    "plate_depth": ("f", ()),
    "plate_tilt": ("f", ()),
    "plate_std": ("f", (2,)),
}


def check_answers(
    answers: Arrays, kind: str, frames: int, where: str, *, guarded: bool = False
) -> None:
    """Raise UserError unless the arrays are packed answers (see ``pack``) to ``frames`` frames.

    Args:
        answers: The arrays.
        kind: "contacts" or "plate".
        frames: Number of test frames.
        where: Name of the file in messages.
        guarded: Whether the frames on which the model failed are listed beside the answers (see
            ``Failures``).
    """
    given = answers
    if guarded:
        answers = {name: array for name, array in answers.items() if name not in FAILURES}
    columns = PLATES if kind == "plate" else CONTACTS
    if set(answers) != set(columns):
        raise UserError(
            f"{where} holds the arrays {', '.join(sorted(answers)) or 'none'}; answers that are "
            f"{kind} are {', '.join(sorted(columns))}."
        )
    for name, (letter, shape) in columns.items():
        array = answers[name]
        if array.dtype.kind != letter or array.shape[1:] != shape or array.ndim != 1 + len(shape):
            raise UserError(
                f"{where}: array {name!r} has type {array.dtype} and shape {array.shape}, which "
                "is not how answers are stored; submit the run with `tactibench board submit`."
            )
    first = "given" if kind == "plate" else "count"
    rows = len(answers[first])
    if rows != frames:
        raise UserError(
            f"{where} answers {rows:,} frames, but the protocol tests {frames:,}; every test "
            "frame needs one answer."
        )
    _check_lengths(answers, columns, kind, where)
    for name, (letter, _) in columns.items():
        if letter == "f":
            _check_finite(answers[name], name, where)
    if kind != "plate" and len(answers["score"]):
        low, high = float(answers["score"].min()), float(answers["score"].max())
        if low < 0 or high > 1:
            raise UserError(f"{where}: scores go from {low:g} to {high:g}; a score lies in 0..1.")
    if guarded:
        _check_failures(given, frames, where)


def _check_failures(answers: Arrays, frames: int, where: str) -> None:
    """Raise UserError unless failures are ascending frames without contacts, each with a cause."""
    failures = {name: answers.get(name, np.empty(0)) for name in FAILURES}
    for name, (letter, _) in FAILURES.items():
        array = failures[name]
        if array.dtype.kind != letter or array.ndim != 1 or len(array) != len(failures["failed"]):
            raise UserError(
                f"{where}: array {name!r} is missing or not how failures are stored; submit the "
                "run with `tactibench board submit`."
            )
    rows = failures["failed"]
    good = (
        bool((np.diff(rows, prepend=-1) > 0).all())
        and bool((rows < frames).all())
        and not answers["count"][rows].any()
    )
    if not good:
        raise UserError(
            f"{where}: the frames on which the model failed are not rising numbers below "
            f"{frames:,} of frames without contacts; submit the run again."
        )
    if any(
        len(cause) > LONGEST_CAUSE or not cause.isprintable()
        for cause in failures["cause"].tolist()
    ):
        raise UserError(
            f"{where}: a cause is longer than {LONGEST_CAUSE} characters or not printable."
        )


def _check_lengths(answers: Arrays, columns: Mapping[str, Any], kind: str, where: str) -> None:
    total = len(answers["given"]) if kind == "plate" else 0
    if kind != "plate":
        count = answers["count"]
        if count.min(initial=0) < 0 or count.max(initial=0) > MOST:
            raise UserError(
                f"{where}: a frame is answered with {int(count.max(initial=0)):,} contacts; "
                f"0 to {MOST} are allowed."
            )
        total = int(count.sum())
    wrong = [name for name in columns if name != "count" and len(answers[name]) != total]
    if wrong:
        raise UserError(
            f"{where}: array {wrong[0]!r} has {len(answers[wrong[0]]):,} rows, but the answers "
            f"are {total:,}."
        )


def _check_finite(array: npt.NDArray[Any], name: str, where: str) -> None:
    """Raise UserError for NaN; a whole row of NaN in standard deviations means "not stated"."""
    bad = ~np.isfinite(array)
    if name.endswith("std"):
        bad &= ~np.isnan(array).all(axis=1, keepdims=True)
    if bad.any():
        raise UserError(
            f"{where}: {int(bad.sum()):,} values of array {name!r} are NaN or infinite; an answer "
            "is finite, and a frame without contacts is answered with none."
        )
    low = SMALLEST_STD if name.endswith("std") else -FARTHEST
    finite = array[np.isfinite(array)]
    if finite.size and not low <= finite.min() <= finite.max() <= FARTHEST:
        raise UserError(
            f"{where}: values of array {name!r} go from {finite.min():g} to {finite.max():g}; "
            f"{low:g} to {FARTHEST:g} are allowed."
        )
