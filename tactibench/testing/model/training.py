"""How a model is built, learns, and keeps what it learned."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from tactibench.plugins.base import FitReport
from tactibench.testing.model.subject import ModelSubject, difference
from tactibench.testing.parameters import check_parameters
from tactibench.testing.pressed import Examples, changes, writable
from tactibench.testing.property import Failed, guarded, refused, require

METHODS = ("fit", "predict", "save", "load")
EXACT = 1e-6
"""mm by which answers of the same weights may differ."""


def target(subject: ModelSubject) -> None:
    """The class behind the spec loads, builds, and has fit, predict, save and load."""
    with guarded(f"building {subject.spec.target}"):
        model = subject.build()
    lacking = [name for name in METHODS if not callable(getattr(model, name, None))]
    require(not lacking, f"it has no {', '.join(lacking)}")


def parameters(subject: ModelSubject) -> None:
    """Every allowed value of a parameter builds or is refused in words; any other is refused."""
    check_parameters(subject.spec, subject.values, subject.build)


def fit(subject: ModelSubject) -> None:
    """Training on 40 frames ends, and gives a FitReport that can be written as JSON."""
    report: object = subject.report()
    require(isinstance(report, FitReport), f"fit gave a {type(report).__name__}")
    assert isinstance(report, FitReport)  # noqa: S101 - for the type checker
    try:
        json.dumps(asdict(report), allow_nan=False, default=lambda value: value.item())
    except (ValueError, TypeError, AttributeError) as error:
        raise Failed(f"the report cannot be written as JSON: {error}") from error


def seed(subject: ModelSubject) -> None:
    """Trainings from equal generator states answer alike, one of them with checkpoints kept."""
    away = difference(subject.ask(subject.again[0], subject.seen.frames), subject.answers)
    require(away <= EXACT, f"answers differ by {away:.3g}; is a global generator used?")


def save_load(subject: ModelSubject) -> None:
    """What was saved into an empty folder answers alike when a new model has loaded it."""
    model = subject.build()
    with TemporaryDirectory() as name:
        folder = Path(name)
        subject.trained().save(folder)
        require(any(p.is_file() for p in folder.rglob("*")), "nothing was written into the folder")
        with guarded("load of what was saved"):
            model.load(folder)
    away = difference(subject.ask(model, subject.seen.frames), subject.answers)
    require(away <= EXACT, f"answers differ by {away:.3g}")


def damaged_weights(subject: ModelSubject) -> None:
    """Weights that are not there, or of which half is missing, are refused with a sentence."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        with refused("an empty folder"):
            subject.build().load(folder)
        subject.trained().save(folder)
        for path in [path for path in folder.rglob("*") if path.is_file()]:
            whole = path.read_bytes()
            path.write_bytes(whole[: len(whole) // 2])
            with refused(f"half of {path.name}"):
                subject.build().load(folder)
            path.write_bytes(whole)


def input_unchanged(subject: ModelSubject) -> None:
    """Training and predicting leave frames and truth as they were."""
    model, changed = subject.again
    require(not changed, f"fit changed {changed}")
    frames = [writable(frame) for frame in subject.seen.frames]
    model.predict(frames)
    now = Examples(tuple(frames), subject.seen.truth)
    changed = changes(subject.seen, now)
    require(not changed, f"predict changed {changed}")
