"""A submission that holds is scored again; everything else gets a sentence."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from changed_record import listed_tables
from few_presses import few_presses

from tactibench import Contacts, SensorSpec, UserError
from tactibench.board import (
    FOLDER,
    Source,
    answers_file,
    compact,
    make_truth,
    ranked_errors,
    verification,
    verify,
)
from tactibench.frames import D_PRIME
from tactibench.geometry import true_contacts
from tactibench.plugins import Catalogue, Origin
from tactibench.protocols import (
    LoadedProtocol,
    commitment_file,
    commitment_text,
    draw_scenes,
    given_seed,
    loader,
    read_protocol,
    split_presses,
)
from tactibench.protocols.loader import SEED_VARIABLE as VARIABLE
from tactibench.records import (
    arrays_hash,
    make_signature,
    pack_contacts,
    read_arrays,
    text_of,
    unpack_contacts,
    write_arrays,
)
from tactibench.run import score_arrays

Submitted = Callable[..., Path]
PACKED = "does not hold answers as tactibench packs them"


@pytest.fixture
def mini(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], LoadedProtocol]:
    """exp1, exp2 and exp3 with few presses, in place of those that ship."""
    files = few_presses(tmp_path / "protocols", prefix="")
    monkeypatch.setattr(loader, "shipped_files", lambda: files)
    return lambda name: read_protocol(files[name])


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Source:
    """A host whose one sensor is tiny."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "run" / "fake")
    specs = {
        "tactip-127": SensorSpec("tactip-127", "tiny_tactile.parts:TinySensor", "tiny"),
        "recorded": SensorSpec(
            "recorded", "tiny_tactile.parts:TinySensor", "tiny", needs_data=True
        ),
    }
    origins = dict.fromkeys(specs, Origin("tiny", "tactibench", "1"))
    none: Any = Catalogue("model", {}, {}, {})
    sensors = Catalogue("sensor", specs, origins, {})
    host: Any = SimpleNamespace(sensors=sensors, models=none, encoders=none)
    return Source(host, tmp_path / "cache")


@pytest.fixture
def submitted(
    mini: Callable[[str], LoadedProtocol], source: Source, tmp_path: Path, fabricate: Any
) -> Submitted:
    """Protocol, keywords of ``fabricate`` -> a submission that holds; the path of its record."""

    def made(asked: str = "exp1", *, hidden: Any = None, **more: Any) -> Path:
        protocol = mini(asked)
        record = fabricate(asked, encoder=None, **more)
        record.protocol.hash = protocol.hash
        record.sensor.parameters = {}
        record.identity.plugins = {"unet": {"distribution": "tactibench"}}
        truth = make_truth(record, protocol, source, hidden)
        record.data.test = len(truth["press"])
        answers = pack_contacts([moved(contacts) for contacts in unpack_contacts(truth)])
        record.metrics = score_arrays(protocol.spec, truth, answers, {})
        record.identity.predictions_hash = hashed = arrays_hash(answers)
        record.identity.stored = {"predictions": hashed}
        record.signature = make_signature(record)
        path = tmp_path / FOLDER / record.protocol.id / f"{record.name}.json"
        ranked = ranked_errors(protocol.spec, truth, answers)
        write_arrays(answers_file(path), {**answers, **ranked})
        path.write_text(text_of(compact(record)), encoding="utf-8")
        return path

    return made


def moved(contacts: Contacts) -> Contacts:
    """An answer that is 0.1 mm off along x."""
    return Contacts(contacts.xy + np.array([0.1, 0.0]), contacts.depth, np.full(len(contacts), 0.9))


def edited(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    record = listed_tables(path.read_text(encoding="utf-8"))
    change(record)
    path.write_text(json.dumps(record), encoding="utf-8")
    return path


def answered(path: Path, **changes: Any) -> Path:
    """Other answers, and their hash in the record."""
    arrays = {**read_arrays(answers_file(path)), **changes}
    write_arrays(answers_file(path), arrays)
    packed = {name: array for name, array in arrays.items() if not name.startswith("ranked.")}
    hashed = arrays_hash(packed)

    def state(record: dict[str, Any]) -> None:
        record["identity"]["predictions_hash"] = hashed
        record["identity"]["stored"]["predictions"] = hashed

    return edited(path, state)


@pytest.mark.parametrize(("name", "frames"), [("exp1", 20), ("exp2", 28 + 19), ("exp3", 40 + 12)])
def test_a_submission_that_holds_is_verified(submitted, source, name, frames) -> None:
    found = verify(submitted(name), source)
    assert found.frames == frames
    assert {row.metric: row.value for row in found.headline()}["missed"] == 0
    if name == "exp1":
        (mae,) = [row for row in found.again if (row.metric, row.group) == ("mae_mm", "x")]
        assert mae.value == pytest.approx(0.1)


@pytest.mark.slow
def test_a_limit_is_the_word_of_the_record_but_its_form_is_checked(
    submitted, source, monkeypatch
) -> None:
    path = submitted("exp2")  # from before the sensor knew its limit
    from tiny_tactile.parts import TinySensor

    def deviance(_self, scene, _nuisances=()):
        (first, *_), (second, *_) = scene.indenter.offsets
        return (second - first) ** 4

    monkeypatch.setattr(TinySensor, "deviance", deviance)
    assert "limit_mm" not in {row.metric for row in verify(path, source).again}
    found = {"value": D_PRIME**0.5, "low": D_PRIME**0.5, "high": D_PRIME**0.5, "n": 24}
    row = {"metric": "limit_mm", "group": "all", **found, "clusters": 24}
    row |= {"unit": "mm", "better": "none"}
    edited(path, lambda record: record["metrics"].append(row))
    assert "limit_mm" in {row.metric for row in verify(path, source).again}
    edited(path, lambda record: record["metrics"][-1].update(value=1.5, low=1.4))
    verify(path, source)  # another version of the sensor has another limit
    edited(path, lambda record: record["metrics"][-1].update(unit="m"))
    with pytest.raises(UserError, match="states unit m for limit_mm"):
        verify(path, source)


def test_the_truth_is_that_of_the_protocol(mini, source, fabricate) -> None:
    protocol = mini("exp1")
    spec = protocol.spec
    scenes = draw_scenes(spec, "singles").scenes
    wanted = split_presses(len(scenes), spec.split, spec.data_seed).test
    record = fabricate("exp1")
    record.sensor.parameters = {}
    truth = make_truth(record, protocol, source, None)
    assert truth["press"].tolist() == [f"singles-{row}" for row in wanted]
    for contacts, row in zip(unpack_contacts(truth), wanted, strict=True):
        np.testing.assert_array_equal(contacts.xy, true_contacts(scenes[row]).xy)


def test_no_model_is_imported(submitted, source, monkeypatch) -> None:
    path = submitted("exp1", model="a-model-of-mine")
    monkeypatch.setattr("tactibench.plugins.specs.ModelSpec.load", None)
    assert "a-model-of-mine" in verify(path, source).subject


def impossible(record: dict[str, Any]) -> None:
    next(m for m in record["metrics"] if m["metric"] == "missed")["value"] = 1.5


def better(record: dict[str, Any]) -> None:
    row = next(m for m in record["metrics"] if (m["metric"], m["group"]) == ("mae_mm", "mean"))
    row |= {"value": row["value"] / 2, "low": row["value"] / 4}


def stranger(record: dict[str, Any]) -> None:
    record["sensor"]["name"] = "mine"
    record["signature"] = record["signature"].replace("tactip-127", "mine")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda r: r["model"].update(name="<b>best"),
            "holds the name '<b>best'; a name has letters",
        ),
        (lambda r: r["model"].update(name="best | 0.001"), "holds the name 'best . 0.001'"),
        (lambda r: r["training"]["notes"].update(a="<b>best"), "'<b>best', which is .* markup"),
        (
            lambda r: r["environment"].update(cpu="\x1b[2Jgone"),
            r"holds the text .*gone., which is too long or not printable",
        ),
        (
            lambda r: r["sensor"].update(parameters={"table": "../../secret.npz"}),
            "names .*secret.npz.; a committed run must not depend on a path",
        ),
        (lambda r: r.update(partial=True), "is a partial run"),
        (
            lambda r: r["protocol"].update(version=1),
            "answers exp1@1 .* but the present one is exp1@3 .* run the protocol again",
        ),
        (impossible, "a share lies in 0..1"),
        (lambda r: r["metrics"][0].update(censored=">"), "states censored"),
        (better, "for mae_mm of mean, but its predictions give 0.03"),
        (lambda r: r["metrics"].pop(), "does not state every metric"),
        (lambda r: r["metrics"].append(r["metrics"][0]), "one is stated twice"),
        (
            lambda r: r.update(signature=r["signature"].replace("seed:0", "seed:1")),
            r"the signature is .*seed:1.*, but should be .*seed:0",
        ),
        (
            lambda r: (
                r["identity"].update(predictions_hash="ab" * 32),
                r["identity"]["stored"].update(predictions="ab" * 32),
            ),
            "are not those of .* submit the run again",
        ),
        (stranger, "unknown sensor 'mine'"),
    ],
)
def test_a_record_that_does_not_hold(submitted, source, change, words) -> None:
    with pytest.raises(UserError, match=words):
        verify(edited(submitted(), change), source)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: {"xy": np.where(np.arange(40).reshape(20, 2) == 3, np.nan, a["xy"])}, PACKED),
        (lambda a: {"std": np.where(np.arange(60).reshape(20, 3) == 3, 1.0, a["std"])}, PACKED),
        (lambda a: {"score": a["score"] + 1}, PACKED),
        (
            lambda a: {name: a[name][:-1] for name in ("count", "xy", "depth", "score", "std")},
            "answers 19 frames, but the protocol tests 20",
        ),
        (lambda a: {"count": a["count"] * 2}, PACKED),
        (lambda a: {"count": a["count"] * 65}, "more than 64 contacts in a frame"),
        (lambda a: {"depth": a["depth"] + 1e7}, r"a value beyond 1e\+06 mm"),
        (lambda a: {"std": np.full_like(a["std"], 1e-12)}, "a standard deviation below 1e-09"),
        (lambda a: {"count": -a["count"]}, PACKED),
        (lambda a: {"xy": a["xy"][:, :1]}, PACKED),
        (lambda _: {"more": np.zeros(3)}, PACKED),
        (lambda a: {"ranked.error": a["ranked.error"] / 2}, "by which a board ranks, are not"),
    ],
)
def test_answers_that_do_not_hold(submitted, source, change, words) -> None:
    path = submitted()
    with pytest.raises(UserError, match=words):
        verify(answered(path, **change(read_arrays(answers_file(path)))), source)


def test_missing_and_damaged_files(submitted, source, tmp_path) -> None:
    path = submitted()
    place = answers_file(path)
    place.write_bytes(place.read_bytes()[:200])
    with pytest.raises(UserError, match="is no archive of arrays"):
        verify(path, source)
    place.unlink()
    with pytest.raises(UserError, match=r"npz is missing: the answers belong beside"):
        verify(path, source)
    with pytest.raises(UserError, match="does not exist"):
        verify(tmp_path / "nothing.json", source)


@pytest.mark.parametrize(
    ("rows", "says"),
    [(10**7, "67,108,864 bytes that answers may take"), (10**15, "is no archive of arrays")],
)
def test_ten_million_rows_are_refused_unread(submitted, source, rows, says) -> None:
    """Both a true array and a header that only claims its size."""
    path = submitted()
    header = io.BytesIO()
    fields = {"descr": "<f8", "fortran_order": False, "shape": (rows,)}
    np.lib.format.write_array_header_1_0(header, fields)
    body = bytes(8 * rows) if rows == 10**7 else b""
    with zipfile.ZipFile(answers_file(path), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", header.getvalue() + body)
    with pytest.raises(UserError, match=says):
        verify(path, source)


def test_large_strange_and_misnamed_records(submitted, source) -> None:
    path = submitted()
    text = path.read_text(encoding="utf-8")
    other = path.with_name("other.json")
    other.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match="file and folder must be called so"):
        verify(other, source)
    for changed, words in (
        (text + " " * 2**20, "more than the 1,048,576 that a record may take"),
        (text.replace('"seed": 0', '"seed": NaN', 1), "holds NaN, which is no finite number"),
        ("[" * 100_000, "cannot be read as JSON"),
        ("[]", "is no valid record|has record schema"),
    ):
        path.write_text(changed, encoding="utf-8")
        with pytest.raises(UserError, match=words):
            verify(path, source)


def test_recorded_frames_need_their_folder(submitted, source) -> None:
    def recorded(record: dict[str, Any]) -> None:
        record["sensor"] |= {"name": "recorded", "origin": "real"}
        record["signature"] = record["signature"].replace("tactip-127", "recorded")

    with pytest.raises(UserError, match="is in the recording; name its folder with --data DIR"):
        verify(edited(submitted(), recorded), source)


def test_hidden_presses_are_verified_with_the_seed_and_by_all_when_it_is_revealed(
    submitted, source, mini, tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv(VARIABLE, "0123456789abcdef" * 4)
    protocol = mini("exp1")
    seed = given_seed(protocol)
    folder = tmp_path / "trusted"
    folder.mkdir()
    published = commitment_file(protocol, seed.commitment, folder)
    published.write_text(commitment_text(protocol, seed))
    tested = {
        "name": "tactip-127",
        "parameters": {},
        "asked": ["hidden"],
        "on": "hidden presses",
        "presses": 20,
    }
    sensor = {
        "name": "tactip-127",
        "origin": "simulated",
        "parameters": {},
        "settings": [],
        "tested": tested,
    }
    path = submitted("exp1", hidden=seed)
    with pytest.raises(UserError, match="but its predictions give"):
        verify(path, source)  # answers to hidden presses are not answers to the public ones

    def hide(record: dict[str, Any]) -> None:
        record["sensor"] = sensor
        record["signature"] = record["signature"].replace("|weights:", "|test:hidden|weights:")
        record["identity"]["hidden"] = seed.commitment
        record["name"] = record["name"].replace("-s0", "-on-hidden-s0")

    edited(path, hide)
    hidden = path.with_name(path.name.replace("-s0", "-on-hidden-s0"))
    answers_file(path).rename(answers_file(hidden))
    path = path.rename(hidden)
    assert verify(path, source, folder=folder).frames == 20
    with pytest.raises(UserError, match="only runs on published ones are verified"):
        verify(path, source, folder=tmp_path)
    monkeypatch.setenv(VARIABLE, "another seed that is long enough to be one")
    with pytest.raises(UserError, match=f"in {VARIABLE} is not the one with the hash"):
        verify(path, source, folder=folder)
    assert os.environ[VARIABLE] not in path.read_text()
    monkeypatch.delenv(VARIABLE)
    with pytest.raises(UserError, match="a hidden seed is read from"):
        verify(path, source, folder=folder)
    # A pull request reveals the seed of a hash that was published before it.
    beside = path.parents[2] / "hidden" / published.name
    beside.parent.mkdir()
    beside.write_text(commitment_text(protocol, seed, reveal=True))
    assert verify(path, source, folder=folder).frames == 20
    with pytest.raises(UserError, match="only runs on published ones are verified"):
        verify(path, source, folder=tmp_path)
    beside.unlink()
    published.write_text(commitment_text(protocol, seed, reveal=True))
    assert verify(path, source, folder=folder).frames == 20

    def claim(record: dict[str, Any]) -> None:
        record["identity"] |= {"hidden": None}

    edited(path, claim)  # no hash: scored on the public presses, shown among the hidden ones
    with pytest.raises(UserError, match="only runs on published ones are verified"):
        verify(path, source, folder=folder)


def objects(archive: zipfile.ZipFile, header: str, body: bytes = b"") -> None:
    """Add an array with a header of one's own."""
    text = header.encode()
    data = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body
    archive.writestr("depth.npy", data)


@pytest.mark.parametrize(
    "write",
    [
        lambda a: objects(a, "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}\n", b"N."),
        lambda a: objects(a, "{'descr': '<U2147483647', 'fortran_order': False, 'shape': ()}\n"),
        lambda a: objects(a, "(" * 9000),
        lambda a: [a.writestr(f"{k}.npy", b"x") for k in range(100)],
        lambda a: a.writestr("depth.npy", b"x", zipfile.ZIP_LZMA),
    ],
    ids=["objects", "huge", "deep", "many", "lzma"],
)
def test_an_archive_that_tactibench_does_not_write(submitted, source, write) -> None:
    path = submitted()
    with zipfile.ZipFile(answers_file(path), "w") as archive:
        write(archive)
    with pytest.raises(UserError, match=r"is no archive of arrays|that answers may take"):
        verify(path, source)


def test_another_exception_is_a_verdict_on_that_file(submitted, source, monkeypatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of a file")

    monkeypatch.setattr(verification, "score_again", broken)
    with pytest.raises(UserError, match=r"could not be scored again \(ZeroDivisionError: of a"):
        verify(submitted(), source)


def test_the_name_of_a_model_that_ships_is_for_its_own_runs(
    submitted: Submitted, source: Source
) -> None:
    path = submitted()
    assert verify(path, source).record.model.name == "unet"
    edited(path, lambda r: r["identity"]["plugins"]["unet"].update(distribution="mine"))
    with pytest.raises(UserError, match=r"'unet', which is the name of a model that ships .* mine"):
        verify(path, source)
    edited(path, lambda r: r["identity"].update(plugins={}))
    with pytest.raises(UserError, match="names no distribution as its author"):
        verify(path, source)


def test_a_verdict_says_what_it_cannot_know(submitted: Submitted, source: Source) -> None:
    verdict = verify(submitted(), source)
    assert "truth of 20 test frames, which was made again" in verdict.checked
    assert "its training and weights; its times" in verdict.unknown
    knowledge = "what it knew of contacts"
    assert knowledge not in verdict.unknown
    assert knowledge in verify(submitted(model="own"), source).unknown
