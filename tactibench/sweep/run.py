"""A sweep on a cluster: data sets first, then runs; cells that share weights wait for one training.

No more tasks are given out than workers can begin at once, so that a worker that dies loses only
the cell that it was running.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.errors import UserError, describe_exception, is_interruption, printable
from tactibench.metrics import check_metrics
from tactibench.plugins import PluginHost, describe_failure, forbid_exit
from tactibench.records import open_run
from tactibench.run import NullReporter, Reporter, RunPlan, RunRequest, make_plan
from tactibench.sweep.cluster import NO_GPU, Capacity, Cluster, Storage, WorkerLossError
from tactibench.sweep.data_sets import DatasetTask, press_data_set
from tactibench.sweep.plan import CellPlan, find_run
from tactibench.sweep.spec import Cell


@dataclass(frozen=True)
class Outcome:
    """The outcome of a task.

    Attributes:
        name: Name of the run.
        why: Sentence that says why it failed; "" where it did not.
        seconds: Time that it took, s.
    """

    name: str = ""
    why: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class CellResult:
    """A cell and its result.

    Attributes:
        cell: The cell.
        plan: Its state before the sweep.
        outcome: Outcome of its task; None: the run was in the store, or it cannot be run.
    """

    cell: Cell
    plan: CellPlan
    outcome: Outcome | None = None

    @property
    def name(self) -> str:
        """Name of the run in the store; "" where there is none."""
        if self.outcome is not None:
            return self.outcome.name
        return self.plan.name if self.plan.state == "done" else ""

    @property
    def why(self) -> str:
        """Sentence that says why the cell failed or cannot be run; "" where it did not fail."""
        return self.outcome.why if self.outcome is not None else self.plan.why


Work = Callable[[RunRequest, Storage], Outcome]


@dataclass(frozen=True, eq=False)
class Job:
    """A task for a worker.

    Attributes:
        work: Function that the worker calls: ``train_weights`` or ``run_cell``.
        cells: The cells that need it; a training has several.
    """

    work: Work
    cells: tuple[Cell, ...]

    @property
    def needs_gpu(self) -> bool:
        """True where the task needs a graphics card."""
        return self.cells[0].needs_gpu


def run_sweep(
    plans: Mapping[Cell, CellPlan],
    data_sets: Sequence[DatasetTask],
    cluster: Cluster,
    storage: Storage,
    deaths: int,
    reporter: Reporter,
) -> list[CellResult]:
    """Press the data sets that are missing, then run the cells that are to do.

    Args:
        plans: The cells with their plans.
        data_sets: The data sets of the sweep.
        cluster: The workers.
        storage: Folders of runs and cache.
        deaths: Number of deaths of workers after which a cell is still tried again.
        reporter: Shows progress.

    Raises:
        UserError: The scheduler has gone, or a data set cannot be pressed.
    """
    for task in data_sets:
        if not task.is_complete:
            with reporter.task(f"press {task.label}", task.samples) as advance:
                press_data_set(task, cluster, advance)
    outcomes: dict[Cell, Outcome] = {}
    count = sum(plan.state == "to do" for plan in plans.values())
    with reporter.task("runs", count) as advance:
        for cell, outcome in run_jobs(list_jobs(plans), cluster, storage, deaths):
            outcomes[cell] = outcome
            advance(1)
    return [CellResult(cell, plan, outcomes.get(cell)) for cell, plan in plans.items()]


def result_rows(
    results: Iterable[CellResult], data_sets: Iterable[DatasetTask], store: Path
) -> list[dict[str, Any]]:
    """Return rows of metric, group, value, unit.

    They hold every metric of every run in the store, "failed" for every cell that failed, and the
    number of samples of every complete data set.

    Raises:
        UserError: A run is gone or cannot be read.
    """
    rows: list[dict[str, Any]] = []
    for result in results:
        axes = {**result.cell.axes, "seed": result.cell.request.seed}
        if result.why:
            failed = {"metric": "failed", "group": result.cell.label, "value": 1, "unit": ""}
            rows.append({**failed, "why": result.why, **axes})
        elif result.name:
            for metric in open_run(store, result.name).record.metrics:
                row = metric.model_dump(include={"metric", "group", "value", "unit"})
                rows.append({**row, "run": result.name, **axes})
    rows += [
        {"metric": "samples", "group": task.label, "value": task.samples, "unit": ""}
        for task in data_sets
        if task.is_complete
    ]
    return rows


def list_jobs(plans: Mapping[Cell, CellPlan]) -> list[Job]:
    """Return one training for each group of cells with the same missing weights, then the runs.

    The runs of a group are not among them: ``run_jobs`` adds them when its training is done.
    """
    groups: dict[str, list[Cell]] = {}
    for cell, plan in plans.items():
        if plan.state == "to do":
            groups.setdefault(plan.weights, []).append(cell)
    trainings, runs = [], []
    for cells in groups.values():
        if len(cells) > 1 and not plans[cells[0]].trained:
            trainings.append(Job(train_weights, tuple(cells)))
        else:
            runs += [Job(run_cell, (cell,)) for cell in cells]
    return trainings + runs


def run_jobs(
    jobs: Sequence[Job], cluster: Cluster, storage: Storage, deaths: int
) -> Iterator[tuple[Cell, Outcome]]:
    """Yield every cell with its outcome, in the order in which they finish.

    Args:
        jobs: Trainings and runs, in the order in which they should begin.
        cluster: The workers.
        storage: Folders of runs and cache.
        deaths: Number of deaths of workers after which a task is still tried again.
    """
    waiting = list(jobs)
    running: dict[object, Job] = {}
    had_gpu = False
    while waiting or running:
        capacity = cluster.capacity()
        had_gpu |= bool(capacity.gpus)
        # A local worker with a graphics card that died is being started again.
        if capacity.slots and not capacity.gpus and (cluster.remote or not had_gpu):
            refused = [job for job in waiting if job.needs_gpu]
            waiting = [job for job in waiting if not job.needs_gpu]
            yield from ((cell, Outcome(why=NO_GPU)) for job in refused for cell in job.cells)
        while (job := _next_job(waiting, running, capacity)) is not None:
            waiting.remove(job)
            request = job.cells[0].request
            running[cluster.submit(job.work, request, storage, gpu=job.needs_gpu)] = job
        for future in cluster.wait_any(running):
            job = running.pop(future)
            outcome = _outcome(cluster, future, deaths)
            if job.work is train_weights and not outcome.why:
                waiting[:0] = [Job(run_cell, (cell,)) for cell in job.cells]
            else:
                yield from ((cell, outcome) for cell in job.cells)


def _next_job(
    waiting: Sequence[Job], running: Mapping[object, Job], capacity: Capacity
) -> Job | None:
    """Return the first job that a free worker can begin."""
    on_gpu = sum(job.needs_gpu for job in running.values())
    if len(running) >= capacity.slots:
        return None
    return next((job for job in waiting if not job.needs_gpu or on_gpu < capacity.gpus), None)


def _outcome(cluster: Cluster, future: object, deaths: int) -> Outcome:
    try:
        outcome: Outcome = cluster.result(future)
    except WorkerLossError:
        times = "several" if cluster.remote else f"{deaths + 1}"
        return Outcome(
            why=f"the workers that ran it died, {times} in turn (killed, out of memory, or "
            "crashed); run it alone to see why."
        )
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - what a worker cannot even begin
        return Outcome(why=f"the worker could not do it ({type(error).__name__}: {error}).")
    return outcome


def train_weights(request: RunRequest, storage: Storage) -> Outcome:
    """Train the weights of a cell, if they are not in the cache."""

    def train(plan: RunPlan) -> str:
        from tactibench.run import train_model

        train_model(plan, NullReporter())
        return ""

    return _attempt(train, request, storage)


def run_cell(request: RunRequest, storage: Storage) -> Outcome:
    """Run a cell and store it; a run that is stored is not run again.

    A worker may have died after it stored the run and before it reported it, and another sweep may
    use the same store.
    """

    def run(plan: RunPlan) -> str:
        from tactibench.run import execute

        if find_run(plan, storage, {}) is None:
            check_metrics(plan.protocol)
            execute(plan, NullReporter())
        return plan.name

    return _attempt(run, request, storage)


def _attempt(work: Callable[[RunPlan], str], request: RunRequest, storage: Storage) -> Outcome:
    began = time.perf_counter()
    forbid_exit()  # a model that calls os._exit ends its own cell
    name, why = "", ""
    try:
        name = work(make_plan(request, PluginHost(), storage.cache, store=storage.store))
    except (UserError, OSError) as error:
        why = printable(" ".join(str(error).split()))
    except BaseException as error:
        if is_interruption(error):
            raise
        why = describe_failure(error) or f"it raised {describe_exception(error).rstrip('.:')}."
    return Outcome(name, why, time.perf_counter() - began)
