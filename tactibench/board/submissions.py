"""Committed records, from which a board is made: two small files a run.

``leaderboards/submissions/<protocol>/<name>.json`` is the record of a complete run without its
arrays, without the loss of every epoch, and without the sensor's description of itself, of which
the hash stays. ``<name>.npz`` beside it holds the packed predictions, and under ``ranked.`` the
error that orders the board, press by press, so that a board ranks its rows without making any
truth again. Files of strangers are read too: the number and sizes of arrays are checked before
anything is unpacked, and that they are packed answers before a metric reads them.
"""

from __future__ import annotations

import re
import shlex
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.board.rows import label_of, row_key
from tactibench.contacts import FloatArray
from tactibench.errors import UserError, did_you_mean
from tactibench.metrics import AnyTrials, press_shares
from tactibench.protocols import (
    Protocol,
    board_spec,
    recorded_version,
)
from tactibench.records import (
    CHECKSUM,
    Record,
    StoredRun,
    digest,
    pack,
    parse_record,
    read_json,
    refuse_changed,
    unpack,
    write_arrays,
    write_record,
)
from tactibench.run import FAILURE_COLUMNS as FAILURES
from tactibench.run import LONGEST_CAUSE, protocol_of, trials_of

Arrays = dict[str, npt.NDArray[Any]]

FOLDER = "submissions"
LARGEST_RECORD = 2**20
"""Most bytes of a record; the largest committed one has 105 kB."""
NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_-]|\.(?!\.)){0,159}")
"""Form of the name of a run, model, encoder or sensor, which is part of file names and pages."""
LONGEST = 1000
"""Most characters of a text in a record; the longest in committed records has 188."""
RANKED = "ranked."
LARGEST = 64 * 2**20
"""Most bytes of all arrays of a file, unpacked; exp3 needs a third of a megabyte."""
LARGEST_PACKED = 8 * 2**20
"""Most bytes of a file of arrays; the largest committed one has 163 kB."""
MOST_ARRAYS = 16
"""Most arrays of a file. One holds five of answers, three of failures, and for each of three tests
two to rank by."""
MOST_CONTACTS = 64
"""Most contacts in a frame; no protocol presses more than five, and the work of matching grows with
their cube."""
FARTHEST = 1e6
"""Largest value of an answer, mm (a kilometre) or deg: larger ones would overflow when squared."""
SMALLEST_STD = 1e-9
"""Smallest standard deviation, mm or deg; an error is divided by it and squared."""
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Packings that are read. Others may need gigabytes of memory before they unpack a byte."""


# -- records -----------------------------------------------------------------------------------


def compact(record: Record) -> Record:
    """Return the record as it is committed.

    Notes on how a training was resumed are left out: they concern the machine that trained, and may
    name a folder of it.
    """
    values = record.json_values()
    identity = values["identity"]
    identity.pop(CHECKSUM, None)
    for name in ("sensor", "tested"):
        if isinstance(identity.get(name), dict):
            identity[name] = digest(identity[name])
    values["training"].pop("history", None)
    values["training"].get("notes", {}).pop("checkpoint", None)
    return Record.model_validate(values)


def add(run: StoredRun, board: Path) -> tuple[Path, list[Path]]:
    """Commit a run: write its record and answers, and remove older ones of the same row and seed.

    Args:
        run: Stored run.
        board: Folder of the board.

    Returns:
        The file of the record, and the files of the same row and seed that it replaced.

    Raises:
        UserError: The run is partial, answers another version of its protocol, its predictions are
            not those of its record, or its record holds a name or text that a committed record may
            not have.
    """
    refuse_partial(run.record, str(run.folder))
    refuse_names(run.record, str(run.folder))
    predicted = run.arrays("predictions")  # raises where they were changed
    ranked = ranked_errors(protocol_of(run).spec, run.arrays("truth"), predicted)
    record = compact(run.record)
    folder = board / FOLDER / record.protocol.id
    path = folder / f"{record.name}.json"
    same = [
        other
        for other in folder.glob("*.json")
        if other != path and slot(read_submission(other)) == slot(record)
    ]
    write_arrays(answers_file(path), _short({**predicted, **ranked}))
    write_record(path, record)
    for other in same:
        other.unlink()
        answers_file(other).unlink(missing_ok=True)
    return path, same


def committed_protocols(board: Path) -> Iterator[str]:
    """Yield the protocols that have a folder of committed records."""
    place = board / FOLDER
    if place.is_dir():
        yield from sorted(path.name for path in place.iterdir() if path.is_dir())


def check_folder(board: Path, *, writes: bool = False) -> None:
    """Raise UserError where there is no board; writes: whether rows are to be added."""
    if board.is_dir():
        return
    other = f"begin one: `{shlex.join(['mkdir', str(board)])}`" if writes else "leave it out"
    beside = (path.name for path in board.parent.glob("*/"))
    advice = did_you_mean(board.name, beside, f"name another with --board DIR, or {other}.")
    raise UserError(f"there is no folder {board}; {advice}")


def read_submissions(board: Path, protocol: str) -> list[Record]:
    """Return all committed records of a protocol, sorted by the name of the file.

    Raises:
        UserError: A file is no valid record of a complete run of this protocol, in its present
            version, under its own name; or two records are of the same row and seed.
    """
    records = [read_submission(path) for path in sorted((board / FOLDER / protocol).glob("*.json"))]
    versions = {(record.protocol.label, record.protocol.hash): record.name for record in records}
    for (label, content_hash), name in versions.items():
        recorded_version(label, content_hash, name)
    refuse_twins(records)
    return records


def read_submission(path: Path) -> Record:
    """Return a committed record.

    Raises:
        UserError: The file is too large or no valid record of a complete run, was changed, or has
            another name than its record.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UserError(f"{path} is no plain file.")
    if path.is_file() and (size := path.stat().st_size) > LARGEST_RECORD:
        raise UserError(
            f"{path} has {size:,} bytes, more than the {LARGEST_RECORD:,} that a record may take; "
            "a committed record holds no arrays and no history."
        )
    values = read_json(path)
    record = parse_record(values, str(path))
    refuse_changed(values, str(path))
    refuse_partial(record, str(path))
    if record.name != path.stem or record.protocol.id != path.resolve().parent.name:
        raise UserError(
            f"{path} holds the record {record.name!r} of protocol "
            f"{record.protocol.id!r}; file and folder must be called so."
        )
    return record


def slot(record: Record) -> str:
    """Return the key of a row and a training seed, which have one record."""
    return digest([row_key(record), record.seed])


def refuse_twins(records: Sequence[Record]) -> None:
    """Raise UserError for two records of one row and seed: a mean would count the seed twice."""
    seen: dict[str, Record] = {}
    for record in records:
        other = seen.setdefault(slot(record), record)
        if other is not record:
            raise UserError(
                f"{other.name} and {record.name} are both seed {record.seed} of "
                f"{label_of(record)}; keep one of the two files."
            )


def refuse_partial(record: Record, where: str) -> None:
    """Raise UserError for a run that was cut short."""
    if record.partial:
        raise UserError(
            f"{where} is a partial run (--quick or --limit) and has no place on a board; run the "
            "protocol whole."
        )


def refuse_names(record: Record, where: str) -> None:
    """Raise UserError for names and texts that a file name or a page cannot hold as they are.

    Args:
        record: A record that is valid otherwise (see ``parse_record``).
        where: Name of the record in messages.
    """
    names = [record.name, record.regime, record.protocol.id]
    values: list[Any] = []
    for part in (record.model, record.encoder, record.sensor, record.test_sensor):
        if part is not None:
            names.append(part.name)
            values += part.parameters.values()
    for name in names:
        if not NAME.fullmatch(name):
            raise UserError(
                f"{where} holds the name {name[:80]!r}; a name has letters, digits, '.', '_' and "
                "'-' only, at most 160, so that it is neither markup nor a path."
            )
    for value in values:
        if isinstance(value, str) and re.search(r"[/\\]", value):
            raise UserError(
                f"{where} names {value[:80]!r}; a committed run must not depend on a path."
            )
    for text in _texts(record.json_values()):
        if len(text) > LONGEST or not text.isprintable() or re.search(r"<\S", text):
            raise UserError(
                f"{where} holds the text {text[:40]!r}, which is too long or not printable, or "
                f"markup; a text has at most {LONGEST:,} characters."
            )


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in a JSON value, keys included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from value
        value = list(value.values())
    if isinstance(value, list):
        for inner in value:
            yield from _texts(inner)


# -- answers -----------------------------------------------------------------------------------


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


def _press_errors(metric: str, group: str, trials: AnyTrials) -> PressErrors:
    error = press_shares(metric, trials, group)
    finite = np.isfinite(error)
    return PressErrors(np.unique(trials.press)[finite], error[finite])


def all_press_errors(board: Path, records: Iterable[Record]) -> dict[str, PressErrors]:
    """Return the errors of all records that have predictions, by the name of the record.

    Raises:
        UserError: A file of predictions is damaged.
    """
    # Records of one test set name the same presses; these names are held in memory once.
    names: dict[bytes, npt.NDArray[Any]] = {}
    by_name = {}
    for record in records:
        place = board / FOLDER / record.protocol.id / f"{record.name}.json"
        errors = read_press_errors(answers_file(place))
        if errors is not None:
            press = names.setdefault(errors.press.tobytes(), errors.press)
            by_name[record.name] = replace(errors, press=press)
    return by_name


def read_press_errors(path: Path) -> PressErrors | None:
    """Return the errors that a board ranks by, read from the file of the predictions.

    None where the file is missing, or holds no errors to rank by.

    Raises:
        UserError: The file is damaged, or does not hold one finite error a press, in their order.
    """
    if not path.is_file():
        return None
    arrays = read_answers_file(path, RANKED)
    read = {}
    for test in {name.removeprefix(RANKED).rpartition(".")[0] for name in arrays}:
        begin = f"{RANKED}{test}{'.' * bool(test)}"
        press, error = (arrays.get(f"{begin}{name}", np.empty(0)) for name in ("press", "error"))
        fitting = press.dtype.kind == "U" and error.dtype.kind == "f" and error.ndim == 1
        if (
            not fitting
            or press.shape != error.shape
            or not np.isfinite(error).all()
            or not (press[1:] > press[:-1]).all()
        ):
            raise UserError(
                f"{path} does not hold one finite error a press, in the order of the presses; "
                "submit the run again."
            )
        read[test] = PressErrors(press, error)
    main = read.pop("", None)
    return None if main is None else replace(main, apart=read)


def _short(arrays: Mapping[str, npt.NDArray[Any]]) -> Arrays:
    """Return arrays in four bytes a number where that loses no digit; they are read as eight."""
    return {
        name: _single(array) if array.dtype.kind == "f" else array for name, array in arrays.items()
    }


def _single(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    with np.errstate(over="ignore"):  # infinity is another number, so that eight bytes are kept
        short = values.astype(np.float32)
    return short if np.array_equal(short, values, equal_nan=True) else values


def split_ranked(arrays: Arrays) -> tuple[Arrays, Arrays]:
    """Return the packed answers, and the arrays whose names begin with ``ranked.``."""
    ranked = {name: array for name, array in arrays.items() if name.startswith(RANKED)}
    return {name: array for name, array in arrays.items() if name not in ranked}, ranked


def read_answers_file(path: Path, begin: str = "") -> Arrays:
    """Return the arrays of a file whose names begin with a text.

    The number of arrays, their sizes in the archive's directory, and every array's own header are
    checked before memory is taken.

    Raises:
        UserError: The file is missing, damaged or too large, or holds other arrays than tactibench
            writes.
    """
    if path.is_symlink() or not path.is_file():
        raise UserError(f"{path} is missing: the answers belong beside the record.")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if (
                path.stat().st_size > LARGEST_PACKED
                or len(members) > MOST_ARRAYS
                or sum(member.file_size for member in members) > LARGEST
                or any(member.compress_type not in PACKINGS for member in members)
            ):
                raise UserError(
                    f"{path} holds more than the {LARGEST_PACKED:,} bytes, the {MOST_ARRAYS} "
                    f"arrays or, unpacked, the {LARGEST:,} bytes that answers may take; submit "
                    "the answers to the test frames alone."
                )
            return {
                member.filename.removesuffix(".npy"): _read_array(archive, member)
                for member in members
                if member.filename.startswith(begin)
            }
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - what zip, zlib, tokenizer and parser raise
        raise UserError(
            f"{path} is no archive of arrays ({type(error).__name__}); submit the run again."
        ) from None


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    """Return an array whose header tells no other size than the directory of the archive.

    Raises:
        Exception: The data are damaged; any error of zip, zlib and the parsers.
    """
    with archive.open(member) as stream:
        np.lib.format.read_magic(stream)
        shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
        if stream.tell() + prod(shape) * dtype.itemsize != member.file_size:
            raise ValueError("an array of another size than its header tells")
        stream.seek(0)
        array: npt.NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return array.astype(np.float64) if array.dtype == np.float32 else array


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
    if not _are_bounded(answers):
        raise UserError(
            f"{where} holds more than {MOST_CONTACTS} contacts in a frame, a value beyond "
            f"{FARTHEST:g} mm or deg, or a standard deviation below {SMALLEST_STD:g}; a frame "
            "without contacts is answered with none."
        )
    try:
        unpacked = unpack(answers, kind)
        again = pack(unpacked, kind)
        others = [name for name in answers if name not in again]
        good = sorted(others) == (sorted(FAILURES) if guarded else []) and all(
            np.array_equal(answers[name], array, equal_nan=array.dtype.kind == "f")
            for name, array in again.items()
        )
        good = good and (not guarded or _are_failures(answers, len(unpacked)))
    except Exception:  # noqa: BLE001 - what contacts and numpy raise for arrays of anything
        good = False
    if not good:
        raise UserError(
            f"{where} does not hold answers as tactibench packs them: finite {kind}, a score in "
            "0..1, and nothing besides; submit the run with `tactibench board submit`."
        )
    if len(unpacked) != frames:
        raise UserError(
            f"{where} answers {len(unpacked):,} frames, but the protocol tests {frames:,}; every "
            "test frame needs one answer."
        )


def _are_bounded(answers: Arrays) -> bool:
    """Return whether contacts can be made of the arrays, and metrics of these, at bounded cost."""
    counts = answers.get("count", np.zeros(0))
    if counts.dtype.kind in "if" and (counts > MOST_CONTACTS).any():
        return False
    for name, array in answers.items():
        if array.dtype.kind == "f":
            low = SMALLEST_STD if name.endswith("std") else -FARTHEST
            if ((array < low) | (array > FARTHEST)).any():  # NaN: a deviation that is not stated
                return False
    return True


def _are_failures(answers: Arrays, frames: int) -> bool:
    """Return whether failures are rising frames without contacts, each with a printable cause."""
    rows, causes = answers["failed"], answers["cause"].tolist()
    return (
        len({len(answers[name]) for name in FAILURES}) == 1
        and bool((np.diff(rows, prepend=-1) > 0).all() and (rows < frames).all())
        and not answers["count"][rows].any()
        and all(len(cause) <= LONGEST_CAUSE and cause.isprintable() for cause in causes)
    )
