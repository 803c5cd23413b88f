"""An ONNX file answers as its model does, or is not written."""

from __future__ import annotations

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
from tactibench.plugins import PluginHost
from tactibench.run import export_onnx, largest_difference, weights_file

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
    context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0, host.encoders["hertz"].load()())
    values = host.models["unet"].settings({})
    return host.models["unet"].load()(context, **values)


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
