"""Records and answers as somebody would forge them: a committed submission with one untruth in it.

Whatever a stranger can recompute is recomputed, as he would: the signature, the hash of the
answers, the name of the file.
"""

from __future__ import annotations

import copy
import io
import json
import shutil
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.board.predictions import answers_file
from tactibench.board.verification import FROM_MAPS
from tactibench.records.files import arrays_hash, read_arrays, write_arrays
from tactibench.records.record import Record, make_signature

ROOT = Path(__file__).parents[2]
BASES = {
    "plain": "exp2-mean-single-*",
    "encoded": "exp2-unet-single-s0-*",
    "instance": "exp2-superpose-single-on-instance-1-*",
    "reference": "exp2-unet-single-on-reference-*",
    "failing": "stability-superpose-single-*",
    "few": "exp1-superpose-single-n250-*",
}
"""What a forgery begins with -> a committed submission."""

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


SHA = "ab" * 32
SHA_OF_NOTHING = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def _set_sensor(**values: Any) -> Change:
    """Another sensor, said as whoever runs on it would say it."""

    def change(record: Values) -> None:
        record["sensor"]["parameters"] |= values
        record["sensor"]["settings"] = list(values)

    return change


def _heatmap_error(record: Values) -> None:
    """An error of heatmaps, which the run did not store."""
    record["identity"]["stored"]["maps"] = SHA_OF_NOTHING
    for row in record["metrics"]:
        if row["metric"] == "surface_rmse_mm":
            row |= {"value": 0.001, "low": 0.001, "high": 0.001, "n": 9, "clusters": 9}


def _negative_heatmap_error(record: Values) -> None:
    record["identity"]["stored"]["maps"] = SHA
    for row in record["metrics"]:
        if row["metric"] == "surface_rmse_mm":
            row |= {"value": -1.0, "low": -1.0, "high": -1.0, "n": 9, "clusters": 9}


OTHER_SENSOR = {
    "name": "tactip-127",
    "parameters": {},
    "asked": [],
    "on": "the nominal sensor",
    "presses": 1320,
}


def _other_machine(values: Values) -> None:
    values["environment"]["fingerprint"] = values["identity"]["machine"] = "0123456789ab"


def _renamed(values: Values) -> None:
    values["name"] = values["name"].replace("-mean-", "-unet-")


def _oracle(values: Values) -> None:
    """A trivial model under another name: it is ranked, where `mean` stands last."""
    values["model"]["name"] = "oracle"
    values["name"] = values["name"].replace("-mean-", "-oracle-")


def _doubled_speed(values: Values) -> None:
    values["speed"].append(dict(values["speed"][0]))


FORGERIES = (
    # What was tested.
    Forgery("tested.name", "instance", put("sensor.tested.name", "tactip-331")),
    Forgery("tested.name of the trained", "reference", put("sensor.tested.name", "tactip-127")),
    Forgery("tested.parameters", "instance", put("sensor.tested.parameters.noise", False)),
    Forgery("tested.parameters none", "instance", put("sensor.tested.parameters", {})),
    Forgery("tested.parameters lack one", "instance", drop("sensor.tested.parameters.blur")),
    Forgery("tested.on", "instance", put("sensor.tested.on", "a real TacTip, glued by hand")),
    Forgery("tested.on reference", "reference", put("sensor.tested.on", "real scenes")),
    Forgery("tested.asked twice", "reference", put("sensor.tested.asked", ["reference"] * 2)),
    Forgery("tested.asked a folder", "instance", put("sensor.tested.asked", ["data=/etc"])),
    Forgery(
        "tested.asked a file",
        "instance",
        put("sensor.tested.asked", ["sensor.instance=1", "sensor.table=../../../etc/hostname"]),
    ),
    Forgery(
        "tested.asked no shots",
        "instance",
        put("sensor.tested.asked", ["sensor.instance=1", "shots=0"]),
    ),
    Forgery("tested.presses", "instance", put("sensor.tested.presses", 1_000_000)),
    Forgery("tested.trained_on", "instance", put("sensor.tested.trained_on", "a real recording")),
    Forgery("tested.settings", "instance", put("sensor.tested.settings", ["size"])),
    Forgery("tested that is not", "plain", put("sensor.tested", OTHER_SENSOR)),
    Forgery("tested left out", "instance", both(drop("sensor.tested"), drop("identity.tested"))),
    # What was trained on.
    Forgery("sensor.origin", "plain", put("sensor.origin", "real")),
    Forgery("sensor without noise", "plain", put("sensor.parameters.noise", False)),
    Forgery(
        "sensor without noise, unsaid",
        "plain",
        both(put("sensor.parameters.noise", False), put("sensor.settings", [])),
    ),
    Forgery("sensor.settings", "plain", put("sensor.settings", ["size", "noise"])),
    Forgery("sensor.parameters lack one", "plain", drop("sensor.parameters.blur")),
    Forgery("sensor.parameters none", "plain", put("sensor.parameters", {})),
    Forgery("sensor.parameters a file", "plain", put("sensor.parameters.table", "evil.npz")),
    Forgery("sensor.parameters large", "plain", put("sensor.parameters.size", 1024)),
    Forgery("sensor.parameters bool", "plain", put("sensor.parameters.instance", False)),
    Forgery("sensor.parameters 1e308", "plain", put("sensor.parameters.full_well", 1e308)),
    Forgery("sensor.parameters retired", "plain", put("sensor.parameters.tolerance", "perfect")),
    Forgery("sensor.parameters 0 for 0.0", "plain", put("sensor.parameters.blur", 0)),
    Forgery("sensor.parameters -0.0", "plain", put("sensor.parameters.blur", -0.0)),
    Forgery("tested.parameters nearly", "instance", put("sensor.tested.parameters.blur", 1e-12)),
    Forgery("sensor.account", "plain", put("sensor.account", {"test": {"measured": 1320}})),
    Forgery("sensor.instance", "plain", put("sensor.parameters.instance", 7)),
    Forgery(
        "sensor.recording",
        "plain",
        put("sensor.recording", {"label": "mine", "sha256": SHA, "sensor": "TacTip"}),
    ),
    Forgery(
        "sensor.range",
        "plain",
        put(
            "sensor.range",
            {
                "half_width_mm": 1.0,
                "depth_min_mm": 1.0,
                "depth_max_mm": 2.0,
                "dome_radius_mm": None,
            },
        ),
    ),
    Forgery(
        "sensor that moves",
        "plain",
        put("sensor", {"name": "tactip", "origin": "real", "parameters": {"config": "hw.toml"}}),
    ),
    Forgery("regime unknown", "plain", put("regime", "zebra")),
    Forgery("regime other", "plain", put("regime", "multiple")),
    Forgery("sensor of 1000 instances", "plain", _set_sensor(version=1, instances=1000)),
    Forgery("sensor.parameters long", "plain", _set_sensor(glare_seed=10**9 + 1)),
    Forgery("heatmaps of no run", "encoded", _heatmap_error),
    Forgery("heatmaps below nothing", "encoded", _negative_heatmap_error),
    Forgery(
        "one contact in several",
        "plain",
        both(put("model.name", "cnn"), put("regime", "multiple")),
    ),
    # What cut it short.
    Forgery("limits.limit", "plain", put("limits.limit", 10)),
    Forgery("limits.quick", "plain", put("limits.quick", True)),
    Forgery("limits.presses", "plain", put("limits.presses", 100)),
    Forgery("limits.presses negative", "plain", put("limits.presses", -5)),
    Forgery(
        "limits.presses left out",
        "few",
        both(put("limits.presses", None), put("identity.presses", None)),
    ),
    Forgery(
        "limits.presses others",
        "few",
        both(put("limits.presses", 100), put("identity.presses", 100)),
    ),
    Forgery("limits.more", "plain", put("limits.verified", True)),
    # What it was made of.
    Forgery("identity.limit", "plain", put("identity.limit", 10)),
    Forgery("identity.quick", "plain", put("identity.quick", True)),
    Forgery("identity.presses", "plain", put("identity.presses", 100)),
    Forgery("identity.seed", "plain", put("identity.seed", 5)),
    Forgery("identity.protocol", "plain", put("identity.protocol", "exp9@1")),
    Forgery("identity.hidden", "plain", put("identity.hidden", SHA)),
    Forgery("identity.encoder", "encoded", put("identity.encoder.parameters.blur", 9.0)),
    Forgery("identity.tested", "plain", put("identity.tested", SHA)),
    Forgery("identity.tested none", "instance", drop("identity.tested")),
    Forgery("identity.shots", "plain", put("identity.shots", SHA)),
    Forgery("identity.released", "plain", put("identity.released", [{"table": "mine"}])),
    Forgery("identity.data none", "plain", put("identity.data", None)),
    Forgery("identity.data few", "plain", put("identity.data", [SHA])),
    Forgery("identity.data words", "plain", put("identity.data", ["real", "frames"])),
    Forgery("identity.test_frames", "plain", put("identity.test_frames", [])),
    Forgery("identity.plugins none", "plain", put("identity.plugins", {})),
    Forgery("identity.plugins other", "plain", put("identity.plugins.sim.distribution", "my-sim")),
    Forgery("identity.machine", "plain", put("identity.machine", "0123456789ab")),
    Forgery("identity.more", "plain", put("identity.reviewed", "yes")),
    Forgery("identity.stored more", "plain", put("identity.stored.audit", SHA)),
    Forgery("identity.commit", "plain", put("identity.commit", "reviewed")),
    Forgery("identity.code", "plain", put("identity.code", "mine")),
    Forgery("identity.weights_hash", "plain", put("identity.weights_hash", "best")),
    Forgery("identity.checksum", "plain", put("identity.sealed", SHA)),
    # Where it ran and how long it took.
    Forgery("environment.fingerprint", "plain", _other_machine),
    Forgery("environment.cpu", "plain", put("environment.cpu", "Cray")),
    Forgery("environment.threads", "plain", put("environment.threads", 0)),
    Forgery("environment.more", "plain", put("environment.audited", True)),
    Forgery("speed negative", "plain", put("speed.0.mean_ms", -1.0)),
    Forgery("speed twice", "plain", _doubled_speed),
    Forgery("speed.scenario", "plain", put("speed.0.scenario", "magic")),
    Forgery("speed.per_s", "plain", put("speed.0.per_s", 1e300)),
    Forgery("speed.threads", "plain", put("speed.0.threads", -1)),
    Forgery("timed.more", "plain", put("timed.certified", True)),
    Forgery("timed.p50_ms", "plain", put("timed.p50_ms", -3.0)),
    Forgery("efficiency.parameters", "plain", put("efficiency.parameters", -1)),
    Forgery("efficiency.training_s", "plain", put("efficiency.training_s", 1e-6)),
    Forgery("training.seconds", "plain", put("training.seconds", -1.0)),
    Forgery("training.presses", "plain", put("training.presses", 10)),
    Forgery("training.epochs", "plain", put("training.epochs", -3)),
    Forgery("training.more", "plain", put("training.human", True)),
    Forgery("training.notes mixing", "plain", put("training.notes", {"mixing": 3, "prior": "x"})),
    # What was counted.
    Forgery("data.train", "plain", put("data.train", 10)),
    Forgery("data.validation", "plain", put("data.validation", 0)),
    Forgery("data.rejected", "plain", put("data.rejected", 0)),
    Forgery("data.published_frames", "plain", put("data.published_frames", True)),
    Forgery(
        "data.simulator",
        "plain",
        put(
            "data.simulator",
            [
                {
                    "name": "pairs",
                    "scenes": 1320,
                    "unknown": 0,
                    "median_mm": 0.0,
                    "p95_mm": 0.0,
                    "max_mm": 0.0,
                }
            ],
        ),
    ),
    Forgery(
        "data.of_tested_sensor",
        "plain",
        put("data.of_tested_sensor", {"labelled_frames": [50, 50], "unlabelled_frames": 9}),
    ),
    Forgery("data.failures", "plain", put("data.failures", {"frames": 9, "causes": []})),
    Forgery("data.failures left out", "failing", drop("data.failures")),
    Forgery("data.failures made up", "failing", put("data.failures.frames", 99)),
    Forgery("data.more", "plain", put("data.leaked", 0)),
    # What it is called.
    Forgery("protocol.title", "plain", put("protocol.title", "two-point discrimination, hard")),
    Forgery("created", "plain", put("created", "first of all")),
    Forgery("created in the future", "plain", put("created", "9999-01-01T00:00:00+00:00")),
    Forgery("name", "plain", _renamed),
    Forgery("model.name", "plain", _oracle),
    Forgery(
        "model.settings",
        "encoded",
        both(put("model.parameters.epochs", 3), put("model.settings", [])),
    ),
    Forgery("model.parameters", "encoded", put("model.parameters.oracle", True)),
    Forgery(
        "encoder left out", "encoded", both(put("encoder", None), put("identity.encoder", None))
    ),
    Forgery("encoder that is not", "plain", put("encoder", {"name": "hertz", "parameters": {}})),
    Forgery("seed", "plain", both(put("seed", 10**30), put("identity.seed", 10**30))),
    Forgery("seed negative", "plain", both(put("seed", -1), put("identity.seed", -1))),
    Forgery("seed as text", "plain", put("seed", "0")),
)


def forge_text(change: Callable[[str], str], folder: Path) -> Path:
    """Write a submission whose record's text was changed."""
    path = forge(Forgery("text", "plain", lambda _: None), folder)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


TEXTS: dict[str, Callable[[str], str]] = {
    "a key twice": lambda text: text.replace('"partial"', '"partial": true, "partial"', 1),
    "deep": lambda text: "[" * 50_000,
    "deep inside": lambda text: text.replace(
        '"notes": {', '"notes": {"a": ' + "[" * 900 + "]" * 900 + ", ", 1
    ),
    "huge number": lambda text: text.replace('"rejected": ', '"rejected": 9' + "0" * 4000, 1),
    "huge exponent": lambda text: text.replace('"seconds": ', '"seconds": 1e308, "x": ', 1),
    "lone surrogate": lambda text: text.replace('"AMD', '"\\ud800AMD', 1),
    "control": lambda text: text.replace('"AMD', '"\\u001b[2JAMD', 1),
    "right to left": lambda text: text.replace('"AMD', '"\\u202eAMD', 1),
    "many keys": lambda text: text.replace(
        '"notes": {', '"notes": {' + ",".join(f'"k{k}":{k}' for k in range(40_000)) + ", ", 1
    ),
}


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


def _set(name: str, change: Callable[[Any], Any]) -> Callable[[Arrays], Arrays]:
    return lambda arrays: {**arrays, name: change(arrays[name])}


def _filled(value: float) -> Callable[[Any], Any]:
    return lambda array: np.full_like(array, value)


ARRAYS: dict[str, Callable[[Arrays], Arrays]] = {
    "single precision": _set("xy", lambda a: a.astype(np.float32)),
    "long double": _set("xy", lambda a: a.astype(np.longdouble)),
    "half precision": _set("depth", lambda a: a.astype(np.float16)),
    "other byte order": _set("depth", lambda a: a.astype(">f8")),
    "structured": _set("depth", lambda a: np.zeros(len(a), dtype=[("a", "<f8"), ("b", "<i4")])),
    "empty items": _set("depth", lambda a: np.zeros(len(a), dtype="S0")),
    "void": _set("depth", lambda a: np.zeros(len(a), dtype="V7")),
    "times": _set("depth", lambda a: a.astype("datetime64[s]")),
    "no axis": _set("depth", lambda _: np.float64(1.0)),
    "32 axes": _set("depth", lambda a: a.reshape(-1, *[1] * 31)),
    "unsigned": _set("count", lambda a: a.astype(np.uint64)),
    "huge": _set("xy", _filled(1e308)),
    "far away": _set("xy", _filled(1e9)),
    "deep": _set("depth", _filled(-1e308)),
    "subnormal spread": _set("std", _filled(5e-324)),
    "no spread": _set("std", _filled(0.0)),
    "negative spread": _set("std", _filled(-1.0)),
    "huge spread": _set("std", _filled(1e300)),
    "counts that wrap": _set("count", _filled(2**62)),
    "ranked words": _set("ranked.press", lambda a: a.astype("U5000")),
    "ranked none": lambda arrays: {n: a for n, a in arrays.items() if not n.startswith("ranked")},
    "ranked more": lambda arrays: {**arrays, "ranked.more": np.zeros(3)},
    "ranked huge": _set("ranked.error", _filled(1e308)),
    "a path": lambda arrays: {**arrays, "../../evil": np.zeros(1)},
}


def forge_archive(write: Callable[[zipfile.ZipFile, dict[str, bytes]], None], folder: Path) -> Path:
    """Write a submission with an archive of its own making."""
    path = forge(Forgery("archive", "plain", lambda _: None), folder)
    with zipfile.ZipFile(answers_file(path)) as archive:
        members = {member.filename: archive.read(member) for member in archive.infolist()}
    with zipfile.ZipFile(answers_file(path), "w", zipfile.ZIP_DEFLATED) as archive:
        write(archive, members)
    return path


def _array(header: str, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = header.encode("latin-1")
    size = len(text).to_bytes(2 if version[0] == 1 else 4, "little")
    return b"\x93NUMPY" + version + size + text + body


def _with(name: str, data: bytes) -> Callable[[zipfile.ZipFile, dict[str, bytes]], None]:
    def write(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
        for member, body in {**members, name: data}.items():
            archive.writestr(member, body)

    return write


def _tiny_arrays(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
    stream = io.BytesIO()
    np.save(stream, np.zeros(1))
    for name, body in members.items():
        archive.writestr(name, body)
    for number in range(100_000):
        archive.writestr(zipfile.ZipInfo(f"{number}.npy"), stream.getvalue())


def _twice(archive: zipfile.ZipFile, members: dict[str, bytes]) -> None:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, body in [*members.items(), *members.items()]:
            archive.writestr(name, body)


ARCHIVES: dict[str, Callable[[zipfile.ZipFile, dict[str, bytes]], None]] = {
    "100,000 tiny arrays": _tiny_arrays,
    "members twice": _twice,
    "deep header": _with("depth.npy", _array("(" * 9000)),
    "deep long header": _with("depth.npy", _array("[" * 60_000, version=b"\x02\x00")),
    "header of nulls": _with("depth.npy", _array("\0" * 100)),
    "header of operators": _with("depth.npy", _array("-" * 9000 + "1")),
    "header without type": _with("depth.npy", _array("{'shape': (3,)}\n")),
    "strange type": _with(
        "depth.npy",
        _array(
            "{'descr': [('a', [('b', '<f8')], (9, 9))], 'fortran_order': False, 'shape': (3,)}\n"
        ),
    ),
    "huge type": _with(
        "depth.npy", _array("{'descr': '<U2147483647', 'fortran_order': False, 'shape': ()}\n")
    ),
    "objects": _with(
        "depth.npy",
        _array(
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}\n", b"cos\nsystem\n(S'id'\ntR."
        ),
    ),
    "negative shape": _with(
        "depth.npy", _array("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}\n")
    ),
    "shape that wraps": _with(
        "depth.npy",
        _array("{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296, 0)}\n"),
    ),
    "true shape": _with(
        "depth.npy",
        _array("{'descr': '<f8', 'fortran_order': False, 'shape': (True,)}\n", bytes(8)),
    ),
    "no array": _with("depth.npy", b"x"),
    "a script": _with("run.py", b"print(1)"),
}


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
