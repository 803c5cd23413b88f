"""Models of a board timed in turns: the new times go into their records, and nothing else does."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from briefly import time_briefly
from command_line import cli, refused  # noqa: F401 - fixtures
from few_presses import few_presses
from rich.console import Console

from tactibench.board import (
    Timekeeper,
    read_submissions,
    refuse_noise,
    store_times,
    time_models,
    times,
)
from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.records import Record, StoredRun, open_run, stored_runs
from tactibench.report import disturbance, print_times, slowdown
from tactibench.run import Load, NullReporter, Speed, load


@pytest.fixture
def two_runs(cli: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[StoredRun]:  # noqa: F811
    """Runs of two models on a protocol of few presses, in the store ``runs``."""
    few_presses(tmp_path / "protocols")
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(tmp_path / "protocols"))
    time_briefly(monkeypatch.setattr)
    for name, value in (("CALLS", 10), ("BUDGET_S", 0.0), ("BATCHES", (1,)), ("OFFLINE_CALLS", 10)):
        monkeypatch.setattr(times, name, value)
    (tmp_path / "leaderboards").mkdir()
    for model in ("mean", "nearest"):
        code, _, err = cli(f"run few-exp1 --model {model}")
        assert code == 0, err
    return list(stored_runs(tmp_path / "runs"))


def without_times(record: Record) -> dict[str, Any]:
    values = record.json_values()
    for name in ("speed", "timed"):
        del values[name]
    values["identity"] = {k: v for k, v in values["identity"].items() if k != "sealed"}
    values["identity"]["stored"] = {**values["identity"]["stored"], "times": ""}
    return values


def test_new_times_change_nothing_else(cli: Any, two_runs: list[StoredRun], tmp_path: Path) -> None:  # noqa: F811
    assert cli(f"board submit {two_runs[0].record.name}")[0] == 0
    code, out, err = cli("board time few-exp1 --anyway --calls 10 --commit --json times.json")
    assert (code, err) == (0, "")
    for before in two_runs:
        after = open_run(tmp_path / "runs", before.record.name)
        assert without_times(after.record) == without_times(before.record)
        assert after.record.timed.interleaved == 2
        assert after.record.timed.at is not None
        assert after.record.timed.difference_mm == 0
        assert all(row.cpu_ms is not None for row in after.record.speed)
        assert {row.scenario for row in after.record.speed} == {"single", "offline"}
        raw = after.arrays("times")  # the record holds their hash
        assert raw["single_1_threads_ms"].shape == raw["single_1_threads_cpu_ms"].shape
        np.testing.assert_array_equal(
            after.arrays("predictions")["xy"], before.arrays("predictions")["xy"]
        )
        assert before.record.name in out
    committed = read_submissions(tmp_path / "leaderboards", "few-exp1")  # compares checksums
    assert [record.timed.interleaved for record in committed] == [2]
    rows = json.loads((tmp_path / "times.json").read_text(encoding="utf-8"))
    assert {row["run"] for row in rows} == {run.record.name for run in two_runs}


def test_a_machine_that_computes_for_others_is_refused(
    refused: Any,  # noqa: F811
    two_runs: list[StoredRun],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(load, "machine_load", lambda: Load(0.02, 0.34, 3.1))
    said = refused("board time few-exp1")
    assert "34 % of its processors and other machines 2 %" in said
    assert "--anyway" in said
    assert "holds no complete run" in refused("board time few-exp1 --runs exp2-*")


@pytest.mark.parametrize(
    ("noise", "refusals"),
    [
        (Load(), 0),
        (Load(0.0, 0.1), 0),
        (Load(0.05, 0.05), 0),
        (Load(0.05, 0.06), 1),
        (Load(0.2, 0.0), 1),
    ],
)
def test_a_quiet_or_an_unknown_machine_is_taken(noise: Load, refusals: int) -> None:
    said: list[str] = []
    try:
        refuse_noise(noise)
    except UserError as error:
        said.append(str(error))
    assert len(said) == refusals
    assert all("the machine is not quiet" in text for text in said)


def opened(tmp_path: Path) -> Timekeeper:
    return Timekeeper(PluginHost(), tmp_path / "cache", NullReporter())


def test_runs_that_cannot_be_timed_say_why(two_runs: list[StoredRun], tmp_path: Path) -> None:
    run = two_runs[0]
    keeper = opened(tmp_path)

    def refusal(**changes: Any) -> str:
        record = run.record.model_copy(deep=True)
        for path, value in changes.items():
            part, name = path.split("__")
            setattr(getattr(record, part), name, value)
        with pytest.raises(UserError) as error:
            keeper.open(StoredRun(run.folder, record))
        return str(error.value)

    assert "another machine" in refusal(environment__fingerprint="0" * 12)
    assert "are not in the cache" in refusal(identity__weights_hash="0" * 64)
    assert "earlier version" in refusal(protocol__hash="0" * 64)


def test_damaged_weights_are_none(two_runs: list[StoredRun], tmp_path: Path) -> None:
    for path in (tmp_path / "cache" / "weights").glob("*/*"):
        if path.name != "manifest.json":
            path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(UserError, match="are not in the cache"):
        opened(tmp_path).open(two_runs[0])


def test_models_are_called_in_turns(two_runs: list[StoredRun], tmp_path: Path) -> None:
    called: list[str] = []
    keeper = opened(tmp_path)
    models = []
    for run in two_runs:
        model = keeper.open(run)
        name = run.record.model.name
        stages = [("all", lambda _, name=name: called.append(name))]
        models.append(type(model)(run, stages, model.frames, model.timed))
    speeds = time_models(models, NullReporter(), calls=10, batches=())
    assert set(speeds) == {run.record.name for run in two_runs}
    turns = called[-4:]
    assert turns in (["mean", "nearest"] * 2, ["nearest", "mean"] * 2)
    assert len(keeper._frames) == 1


def test_times_out_of_order_are_refused(two_runs: list[StoredRun]) -> None:
    run = two_runs[0]
    speed = Speed(rows=[{**run.record.speed[0].json_values(), "p50_ms": 1e9}])
    with pytest.raises(UserError, match="out of order"):
        store_times(run, speed)
    assert open_run(run.folder.parent, run.record.name).record.speed == run.record.speed


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"cpu_ms": None}, "not measured"),
        ({"cpu_ms": 5.0}, "for 50 % of the time"),
        ({"cpu_ms": 13.0}, "on 1.3 threads"),
        ({"cpu_ms": 19.0, "threads": 2, "stolen": 0.1, "foreign": 0.3}, "others took 40 %"),
        ({"cpu_ms": 10.0, "stolen": 0.2, "foreign": 0.0}, "others took 20 %"),
        ({"cpu_ms": 10.0, "stolen": 0.0, "foreign": 0.0}, "still drifted"),
    ],
)
def test_what_disturbed_is_said(fabricate: Any, change: dict[str, Any], said: str) -> None:
    row = fabricate(p90_ms=10.0).speed[0].model_copy(update=change)
    assert said in disturbance(row)


def timed(fabricate: Any, cpu_ms: float | None, **changes: Any) -> Record:
    record: Record = fabricate(p90_ms=10.0)
    for row in record.speed:
        row.cpu_ms = cpu_ms
        for name, value in changes.items():
            setattr(row, name, value)
    return record


@pytest.mark.parametrize(
    ("then", "now", "expected"),
    [(4.0, 5.0, 1.25), (4.0, 3.0, 0.75), (None, 5.0, None), (4.0, None, None)],
)
def test_a_model_is_its_own_control(
    fabricate: Any, then: float | None, now: float | None, expected: float | None
) -> None:
    assert slowdown(timed(fabricate, then), timed(fabricate, now)) == expected
    assert slowdown(timed(fabricate, then, foreign=0.4, stolen=0.0), timed(fabricate, now)) is None
    other = timed(fabricate, now)
    other.timed.configuration = "float64"
    assert slowdown(timed(fabricate, then), other) is None


@pytest.mark.parametrize(
    ("now", "said"),
    [
        ((10.4, 10.9, 13.0), "median 1.09, 1.04 to 1.30, 3 models"),
        ((11.5, 11.8, 13.0), "NOT COMPARABLE"),
        ((8.5, 8.9, 10.0), "NOT COMPARABLE"),
        ((), ""),
    ],
)
def test_a_machine_of_another_rate_is_told(
    fabricate: Any, now: tuple[float, ...], said: str
) -> None:
    out = StringIO()
    earlier = [timed(fabricate, 10.0 if now else None)] * max(len(now), 1)
    later = [timed(fabricate, cpu_ms) for cpu_ms in now or (10.0,)]
    print_times(Console(file=out, width=300), later, earlier)
    text = out.getvalue()
    assert said in text
    assert ("NOT COMPARABLE" in text) == (said == "NOT COMPARABLE")
    assert ("last settled timing" in text) == bool(now)
