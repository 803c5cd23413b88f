"""The order in which cells begin; the engine is a list of tasks that a test finishes one by one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from briefly import time_briefly

from tactibench.errors import UserError
from tactibench.records import RECORD, read_json, with_checksum, write_json
from tactibench.run import RunRequest
from tactibench.sweep import (
    NO_GPU,
    Capacity,
    Cell,
    CellPlan,
    CellResult,
    Outcome,
    Storage,
    WorkerLossError,
    list_jobs,
    plan_cells,
    plan_requests,
    run_cell,
    run_jobs,
    train_weights,
)

pytestmark = pytest.mark.long

STORAGE = Storage(Path("runs"), Path("cache"))


def cell(name: str, device: str = "cpu") -> Cell:
    axes = {"protocol": "exp1", "model": name, "regime": "", "encoder": "", "sensor": ""}
    return Cell({**axes, "seed": "0"}, RunRequest("exp1", name, device=device))


@dataclass(frozen=True, eq=False)
class Task:
    model: str
    gpu: bool


class Cluster:
    """Finishes its oldest task when it is asked for one; answers: model -> what comes of it."""

    remote = False

    def __init__(self, slots: int = 2, gpus: int = 0, **answers: Any) -> None:
        self.answers = answers
        self.free = Capacity(slots, gpus)
        self.begun: list[str] = []
        self.most = self.most_gpu = 0

    def capacity(self) -> Capacity:
        return self.free

    def submit(self, work: Any, request: RunRequest, storage: Storage, gpu: bool = False) -> Any:
        assert storage is STORAGE
        self.begun.append(f"{'train' if work is train_weights else 'run'} {request.model}")
        return Task(request.model, gpu)

    def wait_any(self, running: Any) -> list[Any]:
        every = list(running)
        self.most = max(self.most, len(every))
        self.most_gpu = max(self.most_gpu, sum(task.gpu for task in every))
        return every[:1]

    def result(self, task: Any) -> Outcome:
        answer = self.answers.get(task.model, Outcome(f"run-{task.model}"))
        if isinstance(answer, Exception):
            raise answer
        return answer


def dispatched(engine: Cluster, planned: dict[Cell, CellPlan]) -> dict[str, Outcome]:
    found = run_jobs(list_jobs(planned), engine, STORAGE, 2)  # type: ignore[arg-type]
    return {one.axes["model"]: outcome for one, outcome in found}


def to_do(*names: str, weights: str = "", device: str = "cpu") -> dict[Cell, CellPlan]:
    return {cell(n, device): CellPlan("to do", f"run-{n}", weights=weights or n) for n in names}


def test_what_is_done_or_cannot_be_is_no_job() -> None:
    planned = {cell("a"): CellPlan("done", "a"), cell("b"): CellPlan("cannot", why="no")}
    assert list_jobs(planned) == []


def test_shared_weights_are_trained_once_and_first() -> None:
    planned = {**to_do("alone"), **to_do("a", "b", "c", weights="w")}
    assert [job.work for job in list_jobs(planned)] == [train_weights, run_cell]
    engine = Cluster(slots=2)
    outcomes = dispatched(engine, planned)
    assert engine.begun[:2] == ["train a", "run alone"]
    assert sorted(engine.begun[2:]) == ["run a", "run b", "run c"]
    assert {name: one.name for name, one in outcomes.items()} == {
        name: f"run-{name}" for name in ("alone", "a", "b", "c")
    }
    assert engine.most == 2, "no more tasks than workers can begin"


def test_weights_in_the_cache_need_no_training() -> None:
    planned = {cell(n): CellPlan("to do", n, weights="w", trained=True) for n in ("a", "b")}
    assert [job.work for job in list_jobs(planned)] == [run_cell, run_cell]


def test_a_failed_training_fails_the_cells_behind_it_and_no_other() -> None:
    planned = {**to_do("a", "b", weights="w"), **to_do("c")}
    outcomes = dispatched(Cluster(a=Outcome(why="no frames.")), planned)
    assert {name: one.why for name, one in outcomes.items()} == {
        "a": "no frames.",
        "b": "no frames.",
        "c": "",
    }


@pytest.mark.parametrize(
    ("raised", "says"),
    [(WorkerLossError(), "died, 3 in turn"), (ValueError("no pickle"), "ValueError: no pickle")],
)
def test_a_cell_that_kills_its_workers_is_reported(raised: Exception, says: str) -> None:
    outcomes = dispatched(Cluster(a=raised), to_do("a", "b"))
    assert says in outcomes["a"].why
    assert outcomes["b"] == Outcome("run-b")


def test_a_scheduler_that_has_gone_ends_the_sweep() -> None:
    with pytest.raises(UserError, match="lost"):
        dispatched(Cluster(a=UserError("the connection was lost")), to_do("a", "b"))


def test_cards_are_for_as_many_as_there_are() -> None:
    planned = {**to_do("a", "b", "c", device="cuda"), **to_do("d", "e")}
    engine = Cluster(slots=3, gpus=1)
    outcomes = dispatched(engine, planned)
    assert engine.begun[:3] == ["run a", "run d", "run e"]
    assert (engine.most, engine.most_gpu) == (3, 1)
    assert len(outcomes) == 5


def test_a_card_whose_worker_is_started_again_is_waited_for() -> None:
    rooms = [Capacity(2, 1), Capacity(2, 0)]

    class Restarting(Cluster):
        def capacity(self) -> Capacity:
            return rooms.pop(0) if rooms else Capacity(2, 1)

    engine = Restarting(gpus=1)
    outcomes = dispatched(engine, to_do("a", "b", device="cuda"))
    assert {one.why for one in outcomes.values()} == {""}


def test_without_a_card_those_that_need_one_are_reported() -> None:
    planned = {**to_do("a", "b", device="cuda"), **to_do("c")}
    engine = Cluster()
    outcomes = dispatched(engine, planned)
    assert engine.begun == ["run c"]
    assert outcomes["a"].why == outcomes["b"].why == NO_GPU


@pytest.fixture
def stored(
    asked: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Any, Storage, Path]:
    """A cell that was run: its request, where it is kept, and the file of its record."""
    from tactibench.plugins import PluginHost
    from tactibench.sweep import list_cells, read_sweep

    time_briefly(monkeypatch.setattr)
    (one, *_) = list_cells(read_sweep(asked('model = "toy"\n')), PluginHost())
    place = Storage(tmp_path / "runs", tmp_path / "cache")
    return one.request, place, place.store / run_cell(one.request, place).name / RECORD


def test_a_run_of_another_machine_counts_where_any_may_run_it(
    stored: tuple[Any, Storage, Path],
) -> None:
    request, place, file = stored
    record = read_json(file)
    record["identity"]["machine"], record["name"] = "another", "elsewhere"
    write_json(file, with_checksum(record))
    file.parent.rename(place.store / "elsewhere")
    (here,) = plan_requests([request], place)
    (anywhere,) = plan_requests([request], replace(place, any_machine=True))
    assert (here.state, anywhere.state, anywhere.name) == ("to do", "done", "elsewhere")


def test_a_run_that_cannot_be_read_is_to_do_again(stored: tuple[Any, Storage, Path]) -> None:
    request, place, file = stored
    name = file.parent.name
    whole = file.read_bytes()
    for spoilt in (b"", whole[: len(whole) // 2], whole.replace(b'"seed": 0', b'"seed": 1', 1)):
        file.write_bytes(spoilt)
        (planned,) = plan_requests([request], place)
        assert (planned.state, planned.name) == ("to do", name)
    outcome = run_cell(request, place)
    assert (outcome.name, outcome.why) == (name, "")
    (planned,) = plan_requests([request], place)
    assert planned.state == "done"
    assert json.loads(file.read_text())["name"] == name


def test_cells_that_come_to_the_same_run_are_one(
    asked: Callable[[str], Path], tmp_path: Path
) -> None:
    from tactibench.plugins import PluginHost
    from tactibench.sweep import list_cells, read_sweep

    text = 'model = ["toy", "toy, noise=0.0", "toy, noise=1", "toy-single"]\n'
    cells = list_cells(read_sweep(asked(text + 'regime = ["single", "multiple"]')), PluginHost())
    planned = plan_cells(cells, Storage(tmp_path / "runs", tmp_path / "cache"))
    kept = [(c.axes["model"], c.axes["regime"], p.state) for c, p in planned.items()]
    assert kept[:2] == [("toy", "single", "to do"), ("toy", "multiple", "to do")]
    assert ("toy, noise=0.0", "single", "to do") not in kept
    assert {
        state for model, regime, state in kept if (model, regime) == ("toy-single", "multiple")
    } == {"cannot"}
    weights = [p.weights for c, p in planned.items() if c.label.endswith("toy single toy seed 0")]
    assert len(weights) == 2
    assert len(set(weights)) == 1, "exp1 and exp2 share them"
    names = [one.name for one in (CellResult(c, p) for c, p in planned.items())]
    assert names == [""] * len(planned)
