"""A run in miniature: small protocols, a tiny sensor and model behind a hand-built host."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from briefly import time_briefly
from fake_distribution import fake_distribution
from few_presses import few_presses

from tactibench import EncoderSpec, ModelSpec, Parameter, SensorSpec
from tactibench.plugins import Catalogue, Origin
from tactibench.records import StoredRun
from tactibench.run import NullReporter, RunPlan, RunRequest, execute, make_plan

ORIGIN = Origin("tiny", "tiny-tactile", "1.0")


def catalogue(kind: str, *specs: Any) -> Catalogue[Any]:
    names = {spec.name: spec for spec in specs}
    return Catalogue(kind, names, dict.fromkeys(names, ORIGIN), {})


@pytest.fixture(autouse=True)
def timed_briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    """See ``time_briefly``; measuring itself is tested where it is called."""
    time_briefly(monkeypatch.setattr)


@pytest.fixture
def unscored(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs have no metrics: intervals of exp2 take seconds, and few tests look at them."""
    monkeypatch.setattr("tactibench.run.score.score_arrays", lambda *_: [])


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The fake plugin's module, with fresh counters."""
    monkeypatch.syspath_prepend(Path(__file__).parent / "fake")
    from tiny_tactile import parts

    monkeypatch.setattr(parts.TinySensor, "pressed", 0)
    for name, value in {"fits": [], "shown": [], "fail_in_fit": False, "behave": "well"}.items():
        monkeypatch.setattr(parts.TinyModel, name, value)
    return parts


@pytest.fixture
def host(tiny: Any) -> Any:
    parameters = (
        Parameter("epochs", 3, "passes", low=1),
        Parameter("width", 8, "has no effect", low=1),
    )
    offset = Parameter("offset", 0.0, "of the frames, grey levels")
    blur = Parameter("blur", 2.0, "has no effect")
    target, encoder = "tiny_tactile.parts:TinyModel", "tiny_tactile.parts:TinyEncoder"
    return SimpleNamespace(
        models=catalogue(
            "model",
            ModelSpec("tiny", target, "reads all tips", parameters),
            ModelSpec("tiny-one", target, "declares one", parameters, max_contacts=1),
            ModelSpec("tiny-plate", target, "plates", parameters, answers=("plate",)),
            ModelSpec("tiny-set", target, "of no kind here", uses_encoder=True, encoders=("set",)),
            ModelSpec("tiny-heat", target, "learns heatmaps", parameters, uses_encoder=True),
            ModelSpec(
                "tiny-mixture",
                target,
                "learns mixtures",
                parameters,
                uses_encoder=True,
                encoders=("mixture",),
                default_encoder="clouds",
            ),
        ),
        sensors=catalogue(
            "sensor",
            SensorSpec("tactip-127", "tiny_tactile.parts:TinySensor", "tiny", (offset,)),
            SensorSpec("other", "tiny_tactile.parts:TinySensor", "tiny"),
            SensorSpec(
                "several",
                "tiny_tactile.parts:TinySensor",
                "one grey level more an instance",
                (Parameter("instance", 0, "another of its make", low=0),),
            ),
            SensorSpec(
                "known",
                "tiny_tactile.parts:TinyReference",
                "reference of tactip-127",
                (offset,),
                reference_of="tactip-127",
                scenes="known scenes",
            ),
            SensorSpec("recorded", "tiny_tactile.parts:TinySensor", "tiny", needs_data=True),
        ),
        encoders=catalogue(
            "encoder",
            EncoderSpec("hertz", encoder, "heat", (blur,), shows_surface=True),
            EncoderSpec("profiles", encoder, "one contact", max_contacts=1),
            EncoderSpec("clouds", encoder, "mixtures", kind="mixture"),
        ),
    )


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tiny model is installed, as far as other processes can tell."""
    fake_distribution(tmp_path / "site", "tiny-tactile", tiny="tiny_tactile.hooks")
    places = (Path(__file__).parent / "fake", tmp_path / "site")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, places)))


@pytest.fixture
def mini(tmp_path: Path) -> Callable[[str], str]:
    """exp1, exp2 and exp3 with few presses, as paths."""
    files = few_presses(tmp_path / "protocols")
    return lambda name: str(files[name])


@pytest.fixture
def planned(host: Any, mini: Callable[[str], str], tmp_path: Path) -> Callable[..., RunPlan]:
    def plan(
        protocol: str = "exp1",
        model: str = "tiny",
        *,
        cache: str = "cache",
        store: str = "runs",
        **more: Any,
    ) -> RunPlan:
        path = protocol if protocol.endswith(".toml") else mini(protocol)
        request = RunRequest(path, model, **more)
        return make_plan(request, host, tmp_path / cache, store=tmp_path / store)

    return plan


@pytest.fixture
def run(planned: Callable[..., RunPlan]) -> Callable[..., StoredRun]:
    return lambda *names, **more: execute(planned(*names, **more), NullReporter())
