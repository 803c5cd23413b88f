"""Records and answers as somebody would forge them: a committed submission with one untruth in it.

Whatever a stranger can recompute is recomputed, as he would: the signature, the hash of the
answers, the name of the file.
"""

from __future__ import annotations

import copy
import json
import shutil
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.board import FROM_MAPS, answers_file
from tactibench.records import Record, arrays_hash, make_signature, read_arrays, write_arrays

ROOT = Path(__file__).parents[2]
BASES = {
    "plain": "exp2-mean-single-s0-*",
    "encoded": "exp2-unet-single-s0-*",
    "instance": "exp2-superpose-single-on-instance-1-*",
    "reference": "exp2-unet-single-on-reference-*",
    "failing": "stability-superpose-single-s0-*",
    "few": "exp1-superpose-single-n250-*",
}
"""What a forgery begins with -> a committed submission."""

SHA_OF_NOTHING = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
"""Of no arrays."""

Values = dict[str, Any]
Change = Callable[[Values], Any]


@dataclass(frozen=True)
class Forgery:
    """One untruth. change: of the record's JSON. sign: whether the signature is made to fit."""

    name: str
    base: str
    change: Change
    sign: bool = True


def base_file(base: str) -> Path:
    """Return the record of a committed submission."""
    found = sorted((ROOT / "leaderboards" / "submissions").glob(f"*/{BASES[base]}.json"))
    return next(path for path in found if answers_file(path).is_file())


def forge(forgery: Forgery, folder: Path) -> Path:
    """Write a forged submission into a folder and return its record's path."""
    path = base_file(forgery.base)
    values = json.loads(path.read_text(encoding="utf-8"))
    forgery.change(values)
    if forgery.sign:
        sign(values)
    place = folder / "submissions" / path.parent.name / f"{values['name']}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(json.dumps(values), encoding="utf-8")
    shutil.copyfile(answers_file(path), answers_file(place))
    return place


def sign(values: Values) -> None:
    """Make the signature fit, where the record can be read at all."""
    try:
        values["signature"] = make_signature(Record.model_validate(copy.deepcopy(values)))
    except ValueError:
        return


def put(place: str, value: Any) -> Change:
    """Return a change of one key, named with dots."""

    def change(values: Values) -> None:
        *parents, last = place.split(".")
        for name in parents:
            values = values.setdefault(name, {}) if isinstance(values, dict) else values[int(name)]
        values[last if isinstance(values, dict) else int(last)] = value

    return change


def drop(place: str) -> Change:
    """Return a change that takes one key away."""

    def change(values: Values) -> None:
        *parents, last = place.split(".")
        for name in parents:
            values = values[name]
        del values[last]

    return change


def both(*changes: Change) -> Change:
    """Return several changes in one."""
    return lambda values: [change(values) for change in changes]


def forge_text(change: Callable[[str], str], folder: Path) -> Path:
    """Write a submission whose record's text was changed."""
    path = forge(Forgery("text", "plain", lambda _: None), folder)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


Arrays = dict[str, Any]


def forge_arrays(change: Callable[[Arrays], Arrays], folder: Path) -> Path:
    """Write a submission with other answers, and their hash in its record."""
    path = forge(Forgery("arrays", "plain", lambda _: None), folder)
    arrays = change(read_arrays(answers_file(path)))
    write_arrays(answers_file(path), arrays)
    state_hash(path, arrays)
    return path


def state_hash(path: Path, arrays: Arrays) -> None:
    """State the hash of the answers in their record, where they have one."""
    try:
        answers = {name: array for name, array in arrays.items() if not name.startswith("ranked.")}
        hashed = arrays_hash(answers)
    except Exception:  # noqa: BLE001 - no hash, so the old one stays
        return
    values = json.loads(path.read_text(encoding="utf-8"))
    values["identity"]["predictions_hash"] = hashed
    values["identity"]["stored"]["predictions"] = hashed
    path.write_text(json.dumps(values), encoding="utf-8")


def forge_archive(write: Callable[[zipfile.ZipFile, dict[str, bytes]], None], folder: Path) -> Path:
    """Write a submission with an archive of its own making."""
    path = forge(Forgery("archive", "plain", lambda _: None), folder)
    with zipfile.ZipFile(answers_file(path)) as archive:
        members = {member.filename: archive.read(member) for member in archive.infolist()}
    with zipfile.ZipFile(answers_file(path), "w", zipfile.ZIP_DEFLATED) as archive:
        write(archive, members)
    return path


def forge_bytes(change: Callable[[bytes], bytes], folder: Path) -> Path:
    """Write a submission whose archive has other bytes."""
    path = forge(Forgery("bytes", "plain", lambda _: None), folder)
    place = answers_file(path)
    place.write_bytes(change(place.read_bytes()))
    return path


ON_WORD = (
    "name",
    "created",
    "identity.weights",
    "identity.sensor",
    "identity.tested",
    "identity.test_frames",
    "identity.code",
    "identity.commit",
    "identity.data",
    "identity.stored",
    "identity.plugins",
    "environment.threads",
    "environment.versions",
    "sensor.parameters.tolerance",
    "sensor.parameters.allow_fem",
    "sensor.tested.parameters.tolerance",
    "sensor.tested.parameters.allow_fem",
    "speed",
    "timed",
    "efficiency",
    "training",
    "data.train",
    "data.validation",
)
"""Keys of which nobody but the submitter knows more than the form: hashes of what is not submitted,
times and trainings, and two parameters that changed no frame."""


def key_forgeries(base: str) -> list[Forgery]:
    """Return a forgery of every value of a record, several of each, its signature made to fit."""
    values = json.loads(base_file(base).read_text(encoding="utf-8"))
    return [
        Forgery(place, base, put(place, other))
        for place, value in _leaves(values)
        if place != "signature" and not _of_heatmaps(values, place)
        for other in _others(value)
        if other != value
        if place != "name" or "/" not in other
    ]


def _of_heatmaps(values: Values, place: str) -> bool:
    """Return whether a value is an error of heatmaps that were stored: they are not submitted."""
    first, _, rest = place.partition(".")
    stored = values["identity"]["stored"]["maps"] != SHA_OF_NOTHING
    number = rest.partition(".")[0]
    return first == "metrics" and stored and values[first][int(number)]["metric"] in FROM_MAPS


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value and its key; of a list the first and the last."""
    if isinstance(value, dict) and value:
        for name, inner in value.items():
            yield from _leaves(inner, f"{place}.{name}".lstrip("."))
    elif isinstance(value, list) and value:
        for number in sorted({0, len(value) - 1}):
            yield from _leaves(value[number], f"{place}.{number}")
    else:
        yield place, value


def _others(value: Any) -> list[Any]:
    """Return values that are not this one."""
    match value:
        case bool():
            return [not value]
        case int():
            return [value + 1, 0 if value else 7]
        case float():
            return [value * 1.01 + 0.01, 0.0 if value else 1.0]
        case str():
            return ["x", value[:-1] + ("1" if value.endswith("0") else "0")]
        case list():
            return [["x"], [1]]
        case dict():
            return [{"x": 1}]
        case _:
            return [1, "x"]
