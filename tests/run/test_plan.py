"""What a request resolves to: parts, parameters, frames, names and the printed plan."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.frames import spread
from tactibench.records import StoredRun
from tactibench.run import (
    RunPlan,
    choose_device,
    cuda_possible,
    read_parameters,
)

Planned = Callable[..., RunPlan]


@given(st.integers(0, 60), st.one_of(st.none(), st.integers(1, 80)))
def test_spread_takes_evenly(rows: int, count: int | None) -> None:
    picked = spread(range(rows), count)
    assert list(picked) == sorted(set(picked))
    assert len(picked) == (rows if count is None else min(rows, count))
    gaps = [b - a for a, b in pairwise(picked)]
    assert not gaps or max(gaps) - min(gaps) <= 1


@pytest.mark.usefixtures("unscored")
def test_quick_is_small_and_partial(planned: Planned, run: Callable[..., StoredRun]) -> None:
    plan = planned("exp2", quick=True)
    assert plan.components.model.values["epochs"] == 2
    assert plan.request.partial
    assert "quick" in plan.name
    record = run("exp2", quick=True).record
    assert record.partial is True
    assert record.limits.json_values() == {"quick": True, "limit": None, "presses": None}
    assert "partial:yes" in record.signature


def test_quick_epochs_do_not_override_what_was_asked(planned: Planned) -> None:
    asked = {"model": {"epochs": "7"}}
    assert planned(quick=True, parameters=asked).components.model.values["epochs"] == 7
    assert planned(parameters=asked).components.model.values["epochs"] == 7
    assert planned().components.model.values["epochs"] == 3
    assert asked == {"model": {"epochs": "7"}}, "the request is left alone"


@pytest.mark.parametrize("limit", [1, 5, 13, 28, 99])
@pytest.mark.usefixtures("unscored")
def test_a_limit_is_spread_over_all_sets(
    planned: Planned, run: Callable[..., StoredRun], limit: int
) -> None:
    plan = planned("exp2", limit=limit)
    assert plan.frames.count("test") == min(limit, 28)
    assert plan.request.partial
    if limit == 13:
        done = run("exp2", limit=13)
        whole = set(run("exp2").arrays("truth")["press"])
        kept = done.arrays("truth")
        assert set(kept["press"]) < whole, "a press keeps its name"
        assert len(set(kept["group"])) > 8
        assert done.record.partial is True


def test_groups_are_the_true_distances(planned: Planned) -> None:
    pairs, catch, between, uneven = planned("exp2").frames.test
    assert set(pairs.groups) == {f"{6.5 + 0.5 * i:.1f}" for i in range(12)}
    assert set(catch.groups) == {"catch"}
    assert {*between.groups, *uneven.groups} == {"heldout:between", "heldout:uneven"}
    kinds = {"dual", "triple", "heldout:three", "heldout:four", "heldout:five"}
    assert {g for w in planned("exp3").frames.test for g in w.groups} == kinds
    assert {g for w in planned("exp1").frames.test for g in w.groups} == {"all"}


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ({"model": "tinny"}, "did you mean 'tiny'?"),
        ({"model": "tiny-plate"}, "answers plate, but protocol 'few-exp1' asks for contacts"),
        ({"regime": "several"}, "no regime 'several'"),
        ({"model": "tiny-one", "regime": "multiple"}, "cannot be trained in regime 'multiple'"),
        ({"sensor": "tactip-128"}, "did you mean 'tactip-127'"),
        ({"encoder": "hertz"}, "uses no encoder"),
        ({"parameters": {"encoder": {"a": "1"}}}, "uses no encoder"),
        ({"model": "tiny-heat", "encoder": "herz"}, "did you mean 'hertz'?"),
        (
            {"model": "tiny-heat", "encoder": "clouds"},
            "encoder 'clouds' is of kind 'mixture', but model 'tiny-heat' learns heat; take "
            "--encoder hertz or profiles.",
        ),
        ({"model": "tiny-mixture", "encoder": "hertz"}, "learns mixture; take --encoder clouds."),
        (
            {"model": "tiny-mixture", "parameters": {"encoder": {"blur": "1"}}},
            "no parameter 'blur'",
        ),
        ({"model": "tiny-set"}, "learns set; no such encoder is installed."),
        (
            {"model": "tiny-heat", "encoder": "profiles", "regime": "multiple"},
            "encoder 'profiles' shows one contact per frame and cannot be trained in regime",
        ),
        ({"parameters": {"model": {"widht": "1"}}}, "did you mean 'width'?"),
        ({"parameters": {"model": {"width": "x"}}}, "must be a whole number"),
        ({"parameters": {"sensor": {"width": "1"}}}, "no parameter 'width'"),
        ({"sensor": "recorded"}, "name their folder with --data"),
        ({"data": Path("nowhere")}, "data folder nowhere does not exist"),
        ({"data": Path(), "sensor": "tactip-127"}, "takes no --data"),
        ({"device": "cuda"}, "--device cuda was asked for"),
    ],
    ids=str,
)
def test_requests_that_cannot_be_met(
    planned: Planned, monkeypatch: pytest.MonkeyPatch, request_: dict[str, Any], said: str
) -> None:
    from tactibench.run import machine

    monkeypatch.setattr(machine, "_has_cuda", lambda: False)
    with pytest.raises(UserError) as raised:
        planned(**request_)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("request_", "encoder"),
    [
        ({}, None),
        ({"model": "tiny-heat"}, "hertz"),
        ({"model": "tiny-heat", "encoder": "profiles"}, "profiles"),
        ({"model": "tiny-mixture"}, "clouds"),
    ],
    ids=str,
)
def test_the_encoder_asked_for_or_the_models_or_the_protocols(
    planned: Planned, request_: dict[str, Any], encoder: str | None
) -> None:
    part = planned(**request_).components.encoder
    assert (part and part.name) == encoder


def test_only_maps_of_the_surface_are_scored_as_one(run: Callable[..., StoredRun]) -> None:
    """Every model of these tests shows maps; of "profiles" the first is no surface."""
    for encoder, counted in (("hertz", True), ("profiles", False)):
        done = run("exp1", "tiny-heat", encoder=encoder)
        for metric in ("surface_rmse_mm", "surface_floor_mm", "surface_excess_mm"):
            rows = [row for row in done.record.metrics if row.metric == metric]
            assert any(row.value is not None for row in rows) == counted
        assert ("surface" in done.arrays("maps")) == counted


def test_a_drawn_sensor_cannot_answer_a_recorded_protocol(planned: Planned) -> None:
    from tactibench.protocols import protocol_files

    with pytest.raises(UserError, match="--sensor recorded --data DIR"):
        planned(str(protocol_files()["surface"]), "tiny-plate", sensor="tactip-127")


@pytest.mark.parametrize("text", ["width=1", "model.width", "model.=1", "models.width=1", "=", ""])
def test_parameters_that_are_not_understood(text: str) -> None:
    with pytest.raises(UserError, match=r"KIND\.NAME=VALUE"):
        read_parameters((text,))


def test_parameters_are_read() -> None:
    found = read_parameters(("model.a=1", "model.b=x=y", "sensor.a="))
    assert found == {"model": {"a": "1", "b": "x=y"}, "sensor": {"a": ""}}
    with pytest.raises(UserError, match="given twice"):
        read_parameters(("model.a=1", "model.a=2"))


@pytest.mark.usefixtures("unscored")
def test_the_plan_says_what_will_be_done(planned: Planned, run: Callable[..., StoredRun]) -> None:
    text = "\n".join(planned("exp2", store="none").lines())
    assert "generate 30 (singles) and 10 (singles, validation) frames on tactip-127" in text
    assert "train tiny on cpu" in text
    tested = "24 (pairs) and 4 (catch) and 11 (between) and 8 (uneven) frames"
    assert f"generate {tested}" in text
    run("exp1")
    text = "\n".join(planned("exp2", store="none").lines())
    assert "take the trained weights from the cache" in text
    assert "singles" not in text, "training frames are not needed any more"
    run("exp2")
    text = "\n".join(planned("exp2", store="none").lines())
    assert f"take {tested} from the cache" in text
    assert "generate" not in text
    assert "is in the store" in "\n".join(planned("exp2").lines())


def test_no_card_is_certain_without_torch(tmp_path: Path) -> None:
    assert not cuda_possible((str(tmp_path / "none"),), "linux")
    assert cuda_possible((str(tmp_path),), "linux")
    assert not cuda_possible((str(tmp_path),), "darwin")
    assert cuda_possible((), "win32")
    assert choose_device("cpu") == "cpu"


@pytest.mark.long
@pytest.mark.skipif(cuda_possible(), reason="a card may be there: torch has to be asked")
def test_planning_imports_neither_torch_nor_the_metrics(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "from tactibench.plugins import PluginHost\n"
        "from tactibench.run import RunRequest, make_plan\n"
        "plan = make_plan(RunRequest('exp1', 'nearest'), PluginHost(), Path(sys.argv[1]))\n"
        "print(plan.name, 'torch' in sys.modules, 'tactibench.metrics' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[1:] == ["False", "False"]
