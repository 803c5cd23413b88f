"""The plan of a sweep and its tasks, without other processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from briefly import time_briefly

from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.records import RECORD, read_json, with_checksum, write_json
from tactibench.run import NullReporter, RunRequest
from tactibench.sweep import (
    NO_GPU,
    Cell,
    CellState,
    Storage,
    list_cells,
    plan_cells,
    plan_requests,
    read_sweep,
    run_cell,
    run_cells,
)

pytest.importorskip("distributed", reason="the engine of sweeps is an extra of its own")
pytestmark = pytest.mark.long

STORAGE = Storage(Path("runs"), Path("cache"))


def cell(name: str, device: str = "cpu") -> Cell:
    axes = {"protocol": "exp1", "model": name, "regime": "", "encoder": "", "sensor": ""}
    return Cell({**axes, "seed": "0"}, RunRequest("exp1", name, device=device))


class Task:
    """Ends between the first and the second time that it is asked: none is forgotten."""

    def __init__(self, value: Any) -> None:
        self.value, self.asked = value, 0

    def done(self) -> bool:
        self.asked += 1
        return self.asked > 1

    def result(self) -> Any:
        if isinstance(self.value, Exception):
            raise self.value
        return self.value


class Client:
    """Finishes every task at once; answers: model -> what comes of it."""

    status = "running"

    def __init__(self, *, gpu: bool = False, **answers: Any) -> None:
        self.answers, self.begun = answers, list[str]()
        self.workers = {"tcp://0": {"resources": {"GPU": 1} if gpu else {}}}

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        return {"workers": self.workers}

    def submit(self, work: Any, request: RunRequest, *more: Any, **options: Any) -> Task:
        after = isinstance(more[-1], Task)
        name = f"{'train' if work.__name__ == 'train_weights' else 'run'} {request.model}"
        assert options == {
            "pure": False,
            "resources": {"GPU": 1} if request.device == "cuda" else None,
        }
        self.begun.append(name + (" after it" if after else ""))
        answer = self.answers.get(request.model, CellState("run", f"run-{request.model}"))
        return Task(answer)


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("distributed.wait", lambda *_, **__: None)


def done(client: Any, states: dict[Cell, CellState]) -> dict[str, CellState]:
    after = run_cells(states, client, STORAGE, NullReporter())
    assert list(after) == list(states)
    return {each.axes["model"]: state for each, state in after.items()}


def to_do(*names: str, weights: str = "", device: str = "cpu") -> dict[Cell, CellState]:
    return {
        cell(n, device): CellState("to do", f"run-{n}", weights=weights or n, trained=False)
        for n in names
    }


def test_what_is_done_or_cannot_be_is_no_task() -> None:
    states = {
        cell("a"): CellState("in the store", "a"),
        cell("b", "cuda"): CellState("failed", why="no"),
    }
    client = Client()
    assert list(done(client, states).values()) == list(states.values())
    assert client.begun == []


def test_shared_weights_are_trained_once_and_waited_for() -> None:
    trained = {cell(n): CellState("to do", n, weights="v", trained=True) for n in ("d", "e")}
    client = Client()
    states = done(client, {**to_do("alone"), **to_do("a", "b", weights="w"), **trained})
    assert client.begun == [
        "run alone",
        "train a",
        "run a after it",
        "run b after it",
        "run d",
        "run e",
    ]
    assert {state.name for state in states.values()} == {
        f"run-{name}" for name in ("alone", "a", "b", "d", "e")
    }


def test_a_failed_training_is_passed_on() -> None:
    failed = CellState("failed", why="no frames.")
    assert run_cell(RunRequest("exp1", "mean"), STORAGE, failed) == failed


def test_a_cell_that_cannot_be_begun_or_kills_its_workers_is_reported() -> None:
    from distributed import KilledWorker

    killed = KilledWorker("a", None, 2)
    states = done(Client(a=killed, b=ValueError("no pickle")), to_do("a", "b", "c"))
    assert "died one after the other" in states["a"].why
    assert "ValueError: no pickle" in states["b"].why
    assert states["c"] == CellState("run", "run-c")


def test_a_scheduler_that_has_gone_ends_the_sweep() -> None:
    client = Client()
    client.status = "closed"
    with pytest.raises(UserError, match="connection to the scheduler was lost"):
        done(client, to_do("a", "b"))


@pytest.mark.parametrize("gpu", [True, False])
def test_cells_that_need_a_card_go_where_one_is(gpu: bool) -> None:
    states = done(Client(gpu=gpu), {**to_do("a", device="cuda"), **to_do("b")})
    assert states["a"].why == ("" if gpu else NO_GPU)
    assert states["b"].state == "run"


@pytest.fixture
def stored(
    asked: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Any, Storage, Path]:
    """A cell that was run: its request, where it is kept, and the file of its record."""
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
    assert (here.state, anywhere.state, anywhere.name) == ("to do", "in the store", "elsewhere")


def test_cells_that_come_to_the_same_run_are_one(
    asked: Callable[[str], Path], tmp_path: Path
) -> None:
    text = 'model = ["toy", "toy, noise=0.0", "toy, noise=1", "toy-single"]\n'
    cells = list_cells(read_sweep(asked(text + 'regime = ["single", "multiple"]')), PluginHost())
    planned = plan_cells(cells, Storage(tmp_path / "runs", tmp_path / "cache"))
    kept = [(c.axes["model"], c.axes["regime"], p.state) for c, p in planned.items()]
    assert kept[:2] == [("toy", "single", "to do"), ("toy", "multiple", "to do")]
    assert ("toy, noise=0.0", "single", "to do") not in kept
    assert {
        state for model, regime, state in kept if (model, regime) == ("toy-single", "multiple")
    } == {"failed"}
    weights = [p.weights for c, p in planned.items() if c.label.endswith("toy single toy seed 0")]
    assert len(weights) == 2
    assert len(set(weights)) == 1, "exp1 and exp2 share them"
