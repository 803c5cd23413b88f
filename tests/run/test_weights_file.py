"""Weights as a file: the same bytes, the same answers, and a refusal of whatever does not match."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import (
    Contacts,
    Frame,
    Grid,
    Indenter,
    ModelContext,
    PlatePose,
    Pose,
    Scene,
    SensorContext,
    UserError,
    open_sensor,
)
from tactibench.lab import open_weights, trained_model
from tactibench.plugins import PluginHost
from tactibench.run import (
    NullReporter,
    RunPlan,
    RunRequest,
    export_onnx,
    export_weights,
    largest_difference,
    make_plan,
    read_description,
    train_model,
    weights_file,
)
from tactibench.training import RefinedModel

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
        values = json.loads(entries["weights.json"]) | changes
        kept = {
            key: value for key, value in values.items() if value is not None or key not in changes
        }
        return {**entries, "weights.json": json.dumps(kept).encode()}

    return change


@pytest.mark.long
def test_a_model_and_its_refinement_share_one_training(tmp_path: Path, frames: Any) -> None:
    def planned(refine: str) -> RunPlan:
        given = {"model": {"refine": refine}}
        request = RunRequest("exp1", "kernel", parameters=given, presses=40, device="cpu")
        return make_plan(request, PluginHost(), tmp_path)

    refined, _ = train_model(planned("fields"), NullReporter())
    plain, weights = train_model(planned("none"), NullReporter())
    assert weights.reused
    assert isinstance(refined, RefinedModel)
    for one, other in zip(plain.predict(frames), refined.model.predict(frames), strict=True):
        assert np.array_equal(one.xy, other.xy)  # type: ignore[union-attr]


def test_equal_weights_are_equal_bytes_and_answer_alike(cache: Path, exported: Path) -> None:
    again = exported.with_name("again.zip")
    description = export_weights(plan_of(cache), again, license_text="CC-BY-4.0")
    assert again.read_bytes() == exported.read_bytes()
    assert read_description(exported) == description
    assert (description.presses, description.license) == (8, "CC-BY-4.0")
    assert description.trained_on == "tactip-127(size=64), regime single of exp1"
    model, label = open_weights(exported)
    trained, weights = train_model(plan_of(cache), NullReporter())
    assert label == f"nearest ({weights.hash[:8]})"
    for one, other in zip(model.predict(FRAMES), trained.predict(FRAMES), strict=True):
        assert np.array_equal(one.xy, other.xy)  # type: ignore[union-attr]
    assert trained_model(str(exported))[1] == label, "`hw live FILE.zip` takes it, too"


def test_there_is_nothing_to_export_without_weights(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="tactibench run exp1 --model nearest --train-only"):
        export_weights(plan_of(tmp_path), tmp_path / "x.zip")
    with pytest.raises(UserError, match="is not there"):
        open_weights(tmp_path / "x.zip")


def flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def test_any_flipped_byte_is_refused_or_changes_no_answer(exported: Path, tmp_path: Path) -> None:
    content, path = exported.read_bytes(), tmp_path / "flipped.zip"
    expected = open_weights(exported)[0].predict(FRAMES)
    for at in np.linspace(0, len(content) - 1, 20).astype(int).tolist():
        path.write_bytes(flipped(content, at))
        try:
            answers = open_weights(path)[0].predict(FRAMES)
        except UserError:
            continue
        for one, other in zip(answers, expected, strict=True):
            assert np.array_equal(one.xy, other.xy)  # type: ignore[union-attr]


def file_of_weights(entries: Entries) -> str:
    return next(name for name in entries if name.startswith("weights/"))


HOSTILE: dict[str, Callable[[Entries], Entries]] = {
    "no zip": lambda entries: entries,
    "a file less": lambda entries: {"weights.json": entries["weights.json"]},
    "no description": lambda entries: {k: v for k, v in entries.items() if k != "weights.json"},
    "other weights": lambda entries: {
        **entries,
        file_of_weights(entries): flipped(entries[file_of_weights(entries)], 100),
    },
    "another schema": described(schema="tactibench-weights/9"),
    "a missing key": described(context=None),
    "up": described(files={"../x": "0" * 64}),
    "absolute": described(files={"/etc/x": "0" * 64}),
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
        open_weights(path)
    assert len(str(error.value)) < 500


def test_a_compressed_file_is_no_bomb(changed: Any) -> None:
    with pytest.raises(UserError, match="are compressed"):
        open_weights(changed(lambda entries: entries, zipfile.ZIP_DEFLATED))


def test_a_model_that_is_not_installed_is_named(changed: Any) -> None:
    with pytest.raises(UserError, match="nobodys"):
        open_weights(changed(described(model={"name": "nobodys", "parameters": {}})))


ONE = Contacts.truth([[1.0, 2.0]], [1.5])


@pytest.mark.parametrize(
    ("answers", "others", "largest"),
    [
        ([], [], 0.0),
        ([None], [None], 0.0),
        ([Contacts.none()], [Contacts.none()], 0.0),
        ([ONE], [Contacts.truth([[1.0, 2.25]], [1.0])], 0.5),
        ([ONE, ONE], [ONE, Contacts.none()], float("inf")),
        ([None], [ONE], float("inf")),
        ([PlatePose(1.0, 2.0)], [PlatePose(1.25, 2.125)], 0.25),
        ([PlatePose(1.0, 2.0)], [ONE], float("inf")),
    ],
)
def test_the_largest_difference(answers: Any, others: Any, largest: float) -> None:
    assert largest_difference(answers, others) == pytest.approx(largest)


def test_a_model_that_is_no_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="StubModel is no network and has no ONNX form"):
        export_onnx(StubModel(), [], tmp_path / "x.onnx", {})


@pytest.fixture
def unet() -> Any:
    host = PluginHost()
    context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, host.encoders["hertz"].build())
    values = host.models["unet"].settings({})
    return host.models["unet"].build(context, **values)


@pytest.fixture
def frames() -> list[Frame]:
    context = SensorContext(np.random.SeedSequence(0))
    with open_sensor("tactip-127", context, {}) as sensor:
        scenes = [Scene(Indenter.single(), Pose(x, 1.0, depth=2.0)) for x in (-2.0, 0.0, 3.0)]
        return list(sensor.press_many(scenes))


def test_without_onnx_the_sentence_says_what_to_install(
    unet: Any, frames: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights_file, "find_spec", lambda _: None)
    with pytest.raises(UserError, match=r"pip install 'tactibench\[onnx\]'"):
        export_onnx(unet, frames, tmp_path / "x.onnx", {})


@pytest.mark.long
def test_the_file_computes_what_the_network_does(unet: Any, frames: Any, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="needs tactibench[onnx]")
    runtime = pytest.importorskip("onnxruntime", reason="needs tactibench[onnx]")
    path = tmp_path / "unet.onnx"
    check = export_onnx(unet, frames, path, {"weights": "abc"})
    assert check.frames == 3
    assert check.largest_share < 1e-4
    assert check.largest_mm < weights_file.MOST_MM
    assert {entry.key: entry.value for entry in onnx.load(path).metadata_props}["weights"] == "abc"
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    for count in (1, 3):  # any number of frames
        (raw,) = session.run(None, {"inputs": unet.inputs(frames[:count]).numpy()})
        assert raw.shape == (count, *check.outputs)


@pytest.mark.long
def test_a_file_that_answers_otherwise_is_not_written(
    unet: Any, frames: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("onnx", reason="needs tactibench[onnx]")
    pytest.importorskip("onnxruntime", reason="needs tactibench[onnx]")
    computed = weights_file._computed
    monkeypatch.setattr(weights_file, "_computed", lambda *given: computed(*given) + 1)
    with pytest.raises(UserError, match="answers otherwise than the model"):
        export_onnx(unet, frames, tmp_path / "x.onnx", {})
    assert list(tmp_path.iterdir()) == []
