"""Weights as a file: the same bytes, the same answers, and a refusal of whatever does not match."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import Frame, Pose, UserError
from tactibench.lab import open_weights, trained_model
from tactibench.plugins import PluginHost
from tactibench.run import (
    NullReporter,
    RunPlan,
    RunRequest,
    WeightsDescription,
    export_weights,
    import_weights,
    make_plan,
    read_weights,
    train_model,
    weights_file,
)

Entries = dict[str, bytes]
DARK = np.zeros((64, 64), np.uint8)
FRAMES = [Frame(DARK + np.uint8(level), 0.0, Pose(), DARK) for level in (10, 90, 200)]


def plan_of(cache: Path) -> RunPlan:
    given = {"sensor": {"size": "64"}}
    request = RunRequest("exp1", "nearest", parameters=given, presses=8, device="cpu")
    return make_plan(request, PluginHost(), cache)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cache")
    train_model(plan_of(folder), NullReporter())
    return folder


@pytest.fixture(scope="module")
def exported(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("out") / "nearest.zip"
    export_weights(plan_of(cache), path, license_text="CC-BY-4.0")
    return path


@pytest.fixture
def changed(exported: Path, tmp_path: Path) -> Callable[..., Path]:
    """A function of the entries -> a file with the entries that it returns."""

    def write(change: Callable[[Entries], Entries], kind: int = zipfile.ZIP_STORED) -> Path:
        with zipfile.ZipFile(exported) as archive:
            entries = {name: archive.read(name) for name in archive.namelist()}
        path = tmp_path / "changed.zip"
        with zipfile.ZipFile(path, "w", kind) as archive:
            for name, content in change(entries).items():
                archive.writestr(name, content)
        return path

    return write


def described(**changes: Any) -> Callable[[Entries], Entries]:
    """A change of ``weights.json``; None takes a key away."""

    def change(entries: Entries) -> Entries:
        values = json.loads(entries["weights.json"])
        for key, value in changes.items():
            values[key] = value
            if value is None:
                del values[key]
        return {**entries, "weights.json": json.dumps(values).encode()}

    return change


def test_equal_weights_are_equal_bytes_and_answer_alike(cache: Path, exported: Path) -> None:
    again = exported.with_name("again.zip")
    export_weights(plan_of(cache), again, license_text="CC-BY-4.0")
    assert again.read_bytes() == exported.read_bytes()
    model, label = open_weights(exported, sha256=read_weights(exported).sha256.upper())
    assert label.startswith("nearest (")
    trained, _ = train_model(plan_of(cache), NullReporter())
    for one, other in zip(model.predict(FRAMES), trained.predict(FRAMES), strict=True):
        assert np.array_equal(one.xy, other.xy)  # type: ignore[union-attr]
    assert trained_model(str(exported))[1] == label, "`hw live FILE.zip` takes it, too"


def test_another_cache_takes_them_and_its_record_would_say_so(
    exported: Path, tmp_path: Path
) -> None:
    file, plan = read_weights(exported), plan_of(tmp_path)
    assert not plan.weights.cached
    folder, there = import_weights(file, tmp_path)
    assert (folder, there) == (plan.weights.folder, False)
    _, weights = train_model(plan, NullReporter())
    assert weights.reused
    assert weights.hash == file.description.hash
    assert weights.report["notes"]["imported"] == file.sha256
    assert import_weights(file, tmp_path)[1] is True


def test_the_card_says_what_they_are(exported: Path) -> None:
    card = read_weights(exported).card
    for words in ("nearest", "tactip-127(size=64)", "8 presses, seed 0", "CC-BY-4.0", "torch "):
        assert words in card


def test_weights_of_other_code_or_versions_are_served_and_not_imported(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights_file, "training_code", lambda _: "other")
    monkeypatch.setattr(weights_file, "installed_versions", lambda *_: {"torch": "9", "numpy": "9"})
    with pytest.raises(UserError, match=r"torch 9 in place of .*other source of nearest") as error:
        import_weights(read_weights(exported), tmp_path)
    assert "serve the file itself" in str(error.value)
    assert list(tmp_path.iterdir()) == []
    assert len(open_weights(exported)[0].predict(FRAMES)) == len(FRAMES)


def test_there_is_nothing_to_export_without_weights(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="tactibench run exp1 --model nearest --train-only"):
        export_weights(plan_of(tmp_path), tmp_path / "x.zip")


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ([f"{number}.npz" for number in range(65)], "there are 65 files, and 1 to 64 are allowed"),
        (["weights (1).npz"], r"'weights \(1\)\.npz' has more than letters"),
        ([], "there are 0 files"),
    ],
    ids=["too many", "a name with blanks", "none"],
)
def test_what_could_not_be_read_back_is_not_written(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], says: str
) -> None:
    files = dict.fromkeys(names, "0" * 64)
    monkeypatch.setattr(weights_file, "intact_manifest", lambda _: {"files": files})
    with pytest.raises(UserError, match=says):
        export_weights(plan_of(cache), tmp_path / "x.zip")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit", ["MOST_BYTES", "MOST_DESCRIPTION_BYTES"])
def test_what_is_too_long_to_be_read_back_is_not_written(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    monkeypatch.setattr(weights_file, limit, 1000)
    with pytest.raises(UserError, match="cannot be exported"):
        export_weights(plan_of(cache), tmp_path / "x.zip")
    assert list(tmp_path.iterdir()) == []


def test_another_file_than_was_named_is_refused(exported: Path) -> None:
    with pytest.raises(UserError, match="not 0000"):
        read_weights(exported, sha256="0" * 64)


def flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def test_any_flipped_byte_is_refused_or_changes_nothing(exported: Path, tmp_path: Path) -> None:
    """The description and the weights are covered; a time stamp or a card's word is no weight."""
    content, path = exported.read_bytes(), tmp_path / "flipped.zip"
    whole = read_weights(exported).description
    for at in np.linspace(0, len(content) - 1, 150).astype(int).tolist():
        path.write_bytes(flipped(content, at))
        try:
            found = read_weights(path)
        except UserError:
            continue
        assert found.description.files == whole.files


HOSTILE = {
    "no zip": lambda entries: entries,
    "a file more": lambda entries: {**entries, "more.txt": b""},
    "a file outside": lambda entries: {**entries, "../outside": b""},
    "a file less": lambda entries: {k: v for k, v in entries.items() if k != "README.md"},
    "no description": lambda entries: {k: v for k, v in entries.items() if k != "weights.json"},
    "no JSON": lambda entries: {**entries, "weights.json": b"{"},
    "a list": lambda entries: {**entries, "weights.json": b"[]"},
    "without an end": lambda entries: {**entries, "weights.json": b"[" * 10**5},
    "NaN": lambda entries: {**entries, "weights.json": b'{"schema": NaN}'},
    "no text": lambda entries: {**entries, "weights.json": b"\xff\xfe"},
    "too long": lambda entries: {**entries, "weights.json": b" " * 2**21},
    "card without text": lambda entries: {**entries, "README.md": b"\xff"},
    "another schema": described(schema="tactibench-weights/9"),
    "an unknown key": described(more=1),
    "a missing key": described(context=None),
    "another hash": described(hash="0" * 64),
    "no files": described(files={}),
    "up": described(files={"../x": "0" * 64}),
    "absolute": described(files={"/etc/x": "0" * 64}),
    "another model": described(model={"name": "mean", "parameters": {}}),
    "an identity of nothing": described(identity={}),
    "a report of nothing": described(report={}),
    "a huge grid": described(
        context={
            "answer": "contacts",
            "cells": [10**9, 10**9],
            "origin_mm": [0, 0],
            "pitch_mm": 1,
            "max_depth_mm": 1,
            "transfers": False,
        }
    ),
}


@pytest.mark.parametrize("how", HOSTILE)
def test_what_does_not_match_is_refused_in_a_sentence(changed: Any, how: str) -> None:
    path = changed(HOSTILE[how])
    if how == "no zip":
        path.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(UserError, match="holds no usable weights: ") as error:
        read_weights(path)
    assert len(str(error.value)) < 500


def test_changed_weights_are_refused_though_the_zip_is_right(changed: Any) -> None:
    def change(entries: Entries) -> Entries:
        name = next(n for n in entries if n.startswith("weights/"))
        return {**entries, name: flipped(entries[name], len(entries[name]) // 2)}

    with pytest.raises(UserError, match=r"the sha256 of .* does not fit"):
        read_weights(changed(change))


def test_a_compressed_file_is_no_bomb(changed: Any) -> None:
    with pytest.raises(UserError, match="compressed or encrypted"):
        read_weights(changed(lambda entries: entries, zipfile.ZIP_DEFLATED))


def test_a_model_that_is_not_installed_is_named(changed: Any, exported: Path) -> None:
    values = json.loads(zipfile.ZipFile(exported).read("weights.json"))
    identity = {**values["identity"], "model": "nobodys"}
    path = changed(described(model={**values["model"], "name": "nobodys"}, identity=identity))
    with pytest.raises(UserError, match="nobodys"):
        open_weights(path)


def test_the_description_is_what_the_file_holds(exported: Path) -> None:
    with zipfile.ZipFile(exported) as archive:
        description = WeightsDescription.model_validate_json(archive.read("weights.json"))
        names = {"weights.json", "README.md", *(f"weights/{name}" for name in description.files)}
        assert set(archive.namelist()) == names
    assert description.presses == 8
    assert description.context.cells == (64, 64)
