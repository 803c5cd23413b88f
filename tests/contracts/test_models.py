"""The contract of a model, held by every model that ships, on networks as small as they get."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from drawn_pins import presses

from tactibench import Contacts, Frame, Model, PlatePose, UserError
from tactibench.plugins import PluginHost
from tactibench.run import NullProgress
from tactibench.testing import (
    PASSED,
    ModelSubject,
    examine,
    expected_failures,
    properties,
    run_checks,
    subject_of,
)
from tactibench.training import save_weights

HOST = PluginHost()
NAMES = list(HOST.models.specs)
TINY: dict[str, dict[str, str]] = {
    "cnn": {"width": "8", "size": "64", "epochs": "6"},
    "mixture": {"width": "16", "epochs": "20"},
    "pins": {"members": "2", "width": "32", "epochs": "20"},
    "unet": {"width": "8", "size": "64", "epochs": "10"},
    "vgnn": {"width": "16", "layers": "2", "epochs": "12"},
}
"""Enough epochs that some frames are answered with a contact: others could not be compared."""
OTHER_ARCHITECTURE: dict[str, list[tuple[str, str]]] = {
    "cnn": [("width", "16"), ("size", "96")],
    "mixture": [("width", "32")],
    "nearest": [("size", "16")],
    "pins": [("members", "3"), ("width", "64")],
    "superpose": [("neighbours", "none")],
    "unet": [("width", "16"), ("size", "96"), ("stem", "1")],
    "vgnn": [("width", "32"), ("layers", "3")],
}
LEARNED = [name for name in NAMES if name in TINY]
"""Models that ``tactibench.training`` trains for some epochs."""
SLOW = [name for name in LEARNED if name != "pins"]


def trained(name: str, *more: str) -> Any:
    """The parameter set of a test that needs a trained model: long for a network."""
    return pytest.param(name, *more, marks=[pytest.mark.long] if name in SLOW else [])


@cache
def subject(name: str) -> ModelSubject:
    """A model that learned from 40 presses of the simulated TacTip."""
    return subject_of("model", name, parameters={"model": TINY.get(name, {})})


def other_subject(name: str, **parameters: str) -> ModelSubject:
    return subject_of("model", name, parameters={"model": {**TINY.get(name, {}), **parameters}})


@pytest.mark.parametrize(
    ("asked", "name"),
    [
        pytest.param(
            asked,
            name,
            id=f"{asked.name}-{name}",
            # Trainings of networks take most of the time, and pins is one, too.
            marks=[pytest.mark.long] if name in SLOW else [],
        )
        for asked in properties("model")
        for name in NAMES
    ],
)
def test_conformance(name: str, asked: Any) -> None:
    expected = expected_failures(subject(name)).get(asked.name)
    finding = examine(asked, subject(name), expected)
    assert finding.ok, finding.line()


OF_SITES = [spec.name for spec in HOST.models.for_answer("sites") if "sites" in spec.answers]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.long] if n == "pins" else []) for n in OF_SITES],
)
def test_conformance_of_models_of_named_places(name: str) -> None:
    parameters = {"model": {"members": "2", "epochs": "5"} if name == "pins" else {}}
    asked = subject_of("model", name, answer="sites", parameters=parameters)
    report = run_checks(properties("model"), asked, expected_failures(asked))
    assert report.ok, [one.line() for one in report.findings if not one.ok]
    assert {"sessions", "batch", "shapes"} <= {
        one.checked.name for one in report.findings if one.outcome == PASSED
    }


@pytest.mark.long
def test_a_unet_learns_through_another_heat_encoder() -> None:
    parameters = {"model": {**TINY["unet"], "epochs": "1", "mixing": "0"}}
    kept = subject_of("model", "unet", encoder="offset", parameters=parameters)
    report = run_checks(properties("model"), kept)
    bad = {one.checked.name: one.line() for one in report.findings if not one.ok}
    bad.pop("finds_contacts", None)  # one epoch is too few
    assert not bad


@pytest.mark.parametrize("name", [trained(name) for name in NAMES])
def test_the_callers_default_type_changes_neither_weights_nor_answers(
    name: str, tmp_path: Path
) -> None:
    short = other_subject(name, epochs="1") if name in LEARNED else subject(name)
    found = []
    for number, dtype in enumerate((torch.float32, torch.float64)):
        torch.set_default_dtype(dtype)
        try:
            model = short.build()
            fit(model, name)
            answers = model.predict(list(subject(name).test_examples.frames[:3]))
        finally:
            torch.set_default_dtype(torch.float32)
        found.append((saved(model, tmp_path / str(number)), [one.xy.tolist() for one in answers]))
    assert found[0] == found[1]


def fit(model: Model, name: str, seed: int = 3, progress: Any = None) -> Any:
    few = subject(name).examples[:24]
    return model.fit(
        list(few.frames),
        list(few.truth),
        validation=(list(few.frames[:4]), list(few.truth[:4])),
        rng=np.random.default_rng(seed),
        progress=progress or NullProgress(),
    )


def saved(model: Model, folder: Path) -> dict[str, bytes]:
    folder.mkdir()
    model.save(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", [trained(name) for name in LEARNED])
def test_only_the_rng_that_is_handed_in_decides_the_weights(name: str, tmp_path: Path) -> None:
    short = other_subject(name, epochs="1")
    weights = []
    with torch.random.fork_rng():
        for number, seed in enumerate((3, 3, 4)):
            torch.manual_seed(number)
            before = torch.random.get_rng_state()
            model = short.build()
            fit(model, name, seed)
            assert torch.equal(before, torch.random.get_rng_state())
            weights.append(saved(model, tmp_path / str(number)))
    first, again, other = weights
    assert first == again
    assert first != other


class StopError(Exception):
    pass


class Stopping(NullProgress):
    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        raise StopError


@pytest.mark.parametrize("name", [trained(name) for name in LEARNED])
def test_a_training_that_was_stopped_goes_on_to_the_same_weights(name: str, tmp_path: Path) -> None:
    short = other_subject(name, epochs="2")
    whole = short.build()
    fit(whole, name)
    checkpoints = tmp_path / "checkpoints"
    checkpoints.mkdir()
    build = short.spec.build
    with pytest.raises(StopError):
        fit(build(short.context(checkpoints), **short.values), name, progress=Stopping())
    resumed = build(short.context(checkpoints), **short.values)
    assert fit(resumed, name).resumed_from == 1
    assert saved(resumed, tmp_path / "resumed") == saved(whole, tmp_path / "whole")


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [trained(name, *other) for name, others in OTHER_ARCHITECTURE.items() for other in others],
)
def test_weights_of_another_architecture_are_refused(
    name: str, parameter: str, value: str, tmp_path: Path
) -> None:
    subject(name).trained().save(tmp_path)
    with pytest.raises(UserError, match=parameter):
        other_subject(name, **{parameter: value}).build().load(tmp_path)


@pytest.mark.parametrize(
    "name", [trained(name) for name in NAMES if len(HOST.models[name].answers) > 1]
)
def test_weights_for_another_kind_of_answer_are_refused(name: str, tmp_path: Path) -> None:
    subject(name).trained().save(tmp_path)
    with pytest.raises(UserError, match=r"answer|plate"):
        replace(subject(name), answer="plate").build().load(tmp_path)


@pytest.mark.parametrize("name", NAMES)
def test_weights_of_another_model_are_refused(name: str, tmp_path: Path) -> None:
    tensors = {"weight": torch.zeros(3)}
    save_weights(tmp_path, tensors, model="stranger", architecture={}, extra={})
    with pytest.raises(UserError, match=r"stranger|does not exist"):
        subject(name).build().load(tmp_path)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("cnn", "unet")])
def test_a_model_that_learned_nothing_does_not_answer(name: str) -> None:
    """A convolutional network answers with its first weights; all others know no pins."""
    with pytest.raises(UserError, match=r"train it|fit it|first"):
        subject(name).build().predict(list(subject(name).test_examples.frames[:1]))


@pytest.mark.parametrize("name", NAMES)
def test_training_without_frames_is_refused(name: str) -> None:
    with pytest.raises(UserError, match=r"train|rest image"):
        subject(name).build().fit(
            [],
            [],
            validation=([], []),
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )


def blank(frame: Frame) -> Frame:
    return Frame(np.zeros_like(frame.image), 0.0, frame.pose, frame.rest)


@pytest.mark.parametrize("name", NAMES)
def test_a_black_frame_is_answered_or_refused(name: str) -> None:
    """A camera that sees nothing is no reason to stop with a traceback."""
    frame = blank(subject(name).test_examples.frames[0])
    try:
        (answer,) = subject(name).trained().predict([frame])
    except UserError:
        return
    assert isinstance(answer, Contacts)
    assert np.isfinite(answer.xy).all()


@pytest.mark.long
@pytest.mark.parametrize(("name", "epochs"), [("cnn", 8), ("vgnn", 8)])
def test_plates_with_labels_of_any_sign_are_read(name: str, epochs: int) -> None:
    """Labels from -3 to 0 mm, as a robot's z."""
    short = other_subject(name, epochs=str(epochs))
    model = replace(short, answer="plate").build()
    rng, progress = np.random.default_rng(3), NullProgress()
    model.fit(*presses(200, 1, True), validation=presses(16, 2, True), rng=rng, progress=progress)
    frames, truth = presses(40, 8, plate=True)
    pairs = [(p, t) for p, t in zip(model.predict(frames), truth, strict=True) if p is not None]
    assert len(pairs) > 20
    assert all(isinstance(pose, PlatePose) for pose, _ in pairs)
    assert np.mean([abs(pose.depth - true.depth) for pose, true in pairs]) < 0.8
    assert np.median([pose.depth for pose, _ in pairs]) < 0
