"""A submission that holds is scored again; everything else gets a sentence."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import UserError
from tactibench.board import Source, answers_file, make_test_set, trusted_host, verify
from tactibench.frames import D_PRIME
from tactibench.geometry import true_contacts
from tactibench.protocols import (
    commitment_file,
    commitment_text,
    draw_scenes,
    given_seed,
    split_presses,
)
from tactibench.protocols.loader import SEED_VARIABLE
from tactibench.records import arrays_hash, read_arrays, unpack_contacts, write_arrays

Submitted = Callable[..., Path]


def edited(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    record = json.loads(path.read_text(encoding="utf-8"))
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


@pytest.mark.parametrize("sign", [">", "<"])
def test_a_row_that_states_more_than_its_answers_give_is_refused(submitted, source, sign) -> None:
    path = edited(submitted(), lambda record: record["metrics"][0].update(censored=sign))
    with pytest.raises(UserError, match="states censored"):
        verify(path, source)


@pytest.mark.parametrize(("name", "frames"), [("exp1", 20), ("exp2", 28 + 19), ("exp3", 40 + 12)])
def test_a_submission_that_holds_is_verified(submitted, source, name, frames) -> None:
    found = verify(submitted(name), source)
    assert found.frames == frames
    assert "times" in found.stated
    assert "surface_rmse_mm" not in found.stated
    assert {row.metric: row.value for row in found.headline()}["missed"] == 0
    if name == "exp1":
        (mae,) = [row for row in found.again if (row.metric, row.group) == ("mae_mm", "x")]
        assert mae.value == pytest.approx(0.1)


def test_a_stated_limit_is_computed_again_and_an_absent_one_is_not(
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
    with pytest.raises(
        UserError, match=r"states low 1\.4 for limit_mm|states value 1\.5 for limit_mm"
    ):
        verify(path, source)


def test_the_truth_is_that_of_the_protocol(mini, source, fabricate) -> None:
    protocol = mini("exp1")
    spec = protocol.spec
    scenes = draw_scenes(spec, "singles").scenes
    wanted = split_presses(len(scenes), spec.split, spec.data_seed).test
    record = fabricate("exp1")
    record.sensor.parameters = {}
    truth = make_test_set(record, protocol, source, None).truth
    assert truth["press"].tolist() == [f"singles-{row}" for row in wanted]
    for contacts, row in zip(unpack_contacts(truth), wanted, strict=True):
        np.testing.assert_array_equal(contacts.xy, true_contacts(scenes[row]).xy)


def test_no_model_and_no_stranger_is_imported(submitted, source, monkeypatch) -> None:
    path = submitted("exp1", model="a-model-of-mine")
    monkeypatch.setattr("tactibench.plugins.specs.ModelSpec.load", None)
    assert "a-model-of-mine" in verify(path, source).subject
    assert {origin.distribution for origin in trusted_host().plugins} == {"tactibench"}


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
            lambda r: r["model"].update(name="<b>best</b>"),
            "model.name is '<b>best</b>'; a name may hold letters",
        ),
        (
            lambda r: r["environment"].update(cpu="\x1b[2Jgone"),
            "environment.cpu holds a text of 8 characters",
        ),
        (
            lambda r: r["sensor"].update(parameters={"table": "../../secret.npz"}),
            "must not depend on a path",
        ),
        (lambda r: r.update(partial=True), "is a partial run"),
        (
            lambda r: r["protocol"].update(version=1),
            "answers exp1@1 .* but the present one is exp1@2 .* run the protocol again",
        ),
        (impossible, "a share lies in 0..1"),
        (better, "for mae_mm of mean, but its predictions give 0.03"),
        (lambda r: r["metrics"].pop(), "lacks .* which the protocol asks for"),
        (
            lambda r: r["metrics"].append({**r["metrics"][-1], "group": "mine"}),
            "states .* of mine, which the protocol does not ask for",
        ),
        (lambda r: r["metrics"].append(r["metrics"][0]), "states a metric of a group twice"),
        (
            lambda r: r.update(signature=r["signature"].replace("seed:0", "seed:1")),
            "the signature says 'seed:1', but the record says 'seed:0'",
        ),
        (
            lambda r: (
                r["identity"].update(predictions_hash="ab" * 32),
                r["identity"]["stored"].update(predictions="ab" * 32),
            ),
            "are not those of .* submit the run again",
        ),
        (lambda r: r["data"].update(test=19), "was tested on 19 frames, but the protocol tests 20"),
        (stranger, "sensor 'mine' does not ship with tactibench"),
    ],
)
def test_a_record_that_does_not_hold(submitted, source, change, words) -> None:
    with pytest.raises(UserError, match=words):
        verify(edited(submitted(), change), source)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda a: {"xy": np.where(np.arange(40).reshape(20, 2) == 3, np.nan, a["xy"])},
            "1 values of array 'xy' are NaN or infinite",
        ),
        (
            lambda a: {"std": np.where(np.arange(60).reshape(20, 3) == 3, 1.0, a["std"])},
            "2 values of array 'std' are NaN",
        ),
        (lambda a: {"score": a["score"] + 1}, "a score lies in 0..1"),
        (lambda a: {"count": a["count"][:-1]}, "answers 19 frames, but the protocol tests 20"),
        (lambda a: {"count": a["count"] * 100}, "answered with 100 contacts; 0 to 64"),
        (lambda a: {"count": a["count"] * 2}, "has 20 rows, but the answers are 40"),
        (lambda a: {"depth": a["depth"].astype(np.int64)}, "array 'depth' has type int64"),
        (lambda a: {"xy": a["xy"][:, :1]}, r"shape \(20, 1\)"),
        (lambda _: {"more": np.zeros(3)}, "holds the arrays count, depth, more"),
        (lambda a: {"ranked.error": a["ranked.error"] / 2}, "by which a board ranks, are not"),
        (lambda a: {"ranked.press": a["ranked.press"][::-1]}, "by which a board ranks, are not"),
    ],
)
def test_answers_that_do_not_hold(submitted, source, change, words) -> None:
    path = submitted()
    with pytest.raises(UserError, match=words):
        verify(answered(path, **change(read_arrays(answers_file(path)))), source)


def test_missing_and_damaged_files(submitted, source, tmp_path) -> None:
    path = submitted()
    place = answers_file(path)
    whole = place.read_bytes()
    place.write_bytes(whole[:200])
    with pytest.raises(UserError, match="is no archive of arrays"):
        verify(path, source)
    place.unlink()
    with pytest.raises(UserError, match=r"npz is missing: without its predictions"):
        verify(path, source)
    elsewhere = tmp_path / "elsewhere.npz"
    elsewhere.write_bytes(whole)
    place.symlink_to(elsewhere)
    with pytest.raises(UserError, match="is missing: the answers belong beside"):
        verify(path, source)
    with pytest.raises(UserError, match="does not exist"):
        verify(tmp_path / "nothing.json", source)


def test_a_changed_array_without_its_hash(submitted, source) -> None:
    path = submitted()
    arrays = read_arrays(answers_file(path))
    write_arrays(answers_file(path), {**arrays, "depth": arrays["depth"] + 1e-9})
    with pytest.raises(UserError, match=r"are not those of .* the record says"):
        verify(path, source)


@pytest.mark.parametrize("rows", [10**7, 10**15])
def test_ten_million_rows_are_refused_unread(submitted, source, rows) -> None:
    """Both a true array and a header that only claims its size."""
    path = submitted()
    header = io.BytesIO()
    fields = {"descr": "<f8", "fortran_order": False, "shape": (rows,)}
    np.lib.format.write_array_header_1_0(header, fields)
    with zipfile.ZipFile(answers_file(path), "w", zipfile.ZIP_DEFLATED) as archive:
        body = bytes(8 * rows) if rows == 10**7 else b""
        archive.writestr("depth.npy", header.getvalue() + body)
    with pytest.raises(UserError, match=r"bytes of arrays, more than the 67,108,864"):
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
        ("[]", "holds a list, not a record"),
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
    monkeypatch.setenv(SEED_VARIABLE, "0123456789abcdef" * 4)
    protocol = mini("exp1")
    seed = given_seed(protocol)
    folder = tmp_path / "hidden"
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
    sensor = {"name": "tactip-127", "origin": "simulated", "parameters": {}, "tested": tested}
    path = submitted("exp1", hidden=seed)
    with pytest.raises(UserError, match="but its predictions give"):
        verify(path, source)  # answers to hidden presses are not answers to the public ones

    def hide(record: dict[str, Any]) -> None:
        record["sensor"] = sensor
        record["signature"] = record["signature"].replace("|weights:", "|test:hidden|weights:")
        record["identity"] |= {"hidden": seed.commitment, "tested": "ab" * 32}
        record["name"] = record["name"].replace("-s0", "-on-hidden-s0")

    edited(path, hide)
    hidden = path.with_name(path.name.replace("-s0", "-on-hidden-s0"))
    answers_file(path).rename(answers_file(hidden))
    path = path.rename(hidden)
    assert verify(path, source, folder=folder).frames == 20
    with pytest.raises(UserError, match="only runs on published ones are verified"):
        verify(path, source, folder=tmp_path)
    monkeypatch.setenv(SEED_VARIABLE, "another seed that is long enough to be one")
    with pytest.raises(UserError, match=f"in {SEED_VARIABLE} is not the one with the hash"):
        verify(path, source, folder=folder)
    assert os.environ[SEED_VARIABLE] not in path.read_text()
    monkeypatch.delenv(SEED_VARIABLE)
    with pytest.raises(UserError, match="is not revealed; only who has it can verify its runs"):
        verify(path, source, folder=folder)
    published.write_text(commitment_text(protocol, seed, reveal=True))
    verdict = verify(path, source, folder=folder)
    assert verdict.frames == 20
    assert "that its hidden seed was still secret" in verdict.stated

    def claim(record: dict[str, Any]) -> None:
        record["identity"] |= {"hidden": None}

    edited(path, claim)  # no hash: scored on the public presses, shown among the hidden ones
    with pytest.raises(UserError, match="only runs on published ones are verified"):
        verify(path, source, folder=folder)


@pytest.mark.parametrize("hidden", ["../../etc", "ab" * 31 + "AB", "é" * 64])
def test_the_hash_of_a_hidden_seed_names_no_file(submitted, source, hidden) -> None:
    def claim(record: dict[str, Any]) -> None:
        record["identity"] |= {"hidden": hidden}

    with pytest.raises(UserError, match=r"identity\.hidden is .*, which is no sha256"):
        verify(edited(submitted(), claim), source)


@pytest.mark.long
def test_a_record_of_an_earlier_version_is_verified(tmp_path: Path) -> None:
    """Two of its families name a tier of the sensor that is no longer there."""
    folder = Path(__file__).parents[3] / "leaderboards" / "submissions" / "stability"
    path = next(folder.glob("stability-mean-*.json"))
    verdict = verify(path, Source(trusted_host(), tmp_path))
    assert verdict.record.protocol.label == "stability@1"
    assert verdict.frames == 7300


def test_labelled_presses_that_no_option_asked_for_are_refused(submitted, source) -> None:
    seen = {"of_tested_sensor": {"labelled_frames": [50]}}
    path = edited(submitted(), lambda record: record["data"].update(seen))
    with pytest.raises(UserError, match=r"shown 50 labelled presses .* its options ask for 0"):
        verify(path, source)
