"""The plan of a sweep: the finished cells, those to run, and those that share a training."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from tactibench.errors import UserError, printable
from tactibench.frames import FramePlan
from tactibench.plugins import PluginHost
from tactibench.records import CHECKSUM, digest, readable_run, stored_runs
from tactibench.run import RunPlan, RunRequest, make_plan
from tactibench.sweep.cluster import NO_GPU, Cluster, Storage, WorkerLossError
from tactibench.sweep.spec import Cell

_RECORD_ONLY = ("commit", "data", "weights_hash", "predictions_hash", "stored", CHECKSUM)
"""Keys of a record's identity that the identity of its plan does not have."""

State = Literal["done", "to do", "cannot"]


@dataclass(frozen=True)
class CellPlan:
    """The state of a cell before it runs.

    Attributes:
        state: "done", "to do", or "cannot".
        name: Name of the run.
        why: Sentence that says why the cell cannot be run.
        weights: Key of the weights; cells with the same key share one training.
        trained: Whether these weights are in the cache.
    """

    state: State
    name: str = ""
    why: str = ""
    weights: str = ""
    trained: bool = False


def plan_cells(
    cells: Iterable[Cell], storage: Storage, cluster: Cluster | None = None
) -> dict[Cell, CellPlan]:
    """Plan all cells, on workers where there is a cluster, else in this process.

    Cells that need a graphics card are planned on a worker that has one. Where several cells are
    the same run, only the first one stays.

    Raises:
        UserError: The workers died, or the scheduler has gone.
    """
    all_cells = list(cells)
    plans: dict[Cell, CellPlan] = {}
    for gpu in (False, True):
        some = [cell for cell in all_cells if cell.needs_gpu == gpu]
        if some:
            requests = [cell.request for cell in some]
            plans |= zip(some, _plan_on(requests, storage, cluster, gpu=gpu), strict=True)
    names: set[str] = set()
    distinct: dict[Cell, CellPlan] = {}
    for cell in all_cells:
        plan = plans[cell]
        if not plan.name or plan.name not in names:
            distinct[cell] = plan
            names.add(plan.name)
    return distinct


def _plan_on(
    requests: list[RunRequest], storage: Storage, cluster: Cluster | None, *, gpu: bool
) -> tuple[CellPlan, ...]:
    if cluster is None:
        return plan_requests(requests, storage)
    if gpu and not cluster.capacity().gpus:
        return (CellPlan("cannot", why=NO_GPU),) * len(requests)
    try:
        plans: tuple[CellPlan, ...] = cluster.wait(
            cluster.submit(plan_requests, requests, storage, gpu=gpu)
        )
    except WorkerLossError:
        raise UserError(
            "the workers that looked the cells up died; see their logs, then run the same command."
        ) from None
    return plans


def plan_requests(requests: Sequence[RunRequest], storage: Storage) -> tuple[CellPlan, ...]:
    """Return the plans of runs, looked up in the store and the cache of this machine."""
    host = PluginHost()
    runs = dict(_runs_by_identity(storage)) if storage.any_machine else {}
    frame_plans: dict[str, FramePlan] = {}

    def plan(request: RunRequest) -> CellPlan:
        try:
            plan = make_plan(request, host, storage.cache, frame_plans)
        except (UserError, OSError) as error:
            return CellPlan("cannot", why=printable(" ".join(str(error).split())))
        return _plan_cell(plan, storage, runs)

    return tuple(plan(request) for request in requests)


def _plan_cell(plan: RunPlan, storage: Storage, runs: Mapping[str, str]) -> CellPlan:
    name = find_run(plan, storage, runs)
    return CellPlan(
        "done" if name else "to do",
        name or plan.name,
        weights=plan.weights.folder.name,
        trained=plan.weights.cached,
    )


def find_run(plan: RunPlan, storage: Storage, runs: Mapping[str, str]) -> str | None:
    """Return the name of the readable run with the plan's identity in the store, if there is one.

    Args:
        plan: The plan of the run.
        storage: Folders of the sweep.
        runs: Hash of the identity without the machine -> name, for runs of any machine.
    """
    if readable_run(storage.store, plan.name) is not None:
        return plan.name
    return runs.get(digest(_without(plan.identity, ("machine",)))) if runs else None


def _runs_by_identity(storage: Storage) -> Iterator[tuple[str, str]]:
    """Yield, for every stored run, the hash of its identity without the machine, and its name."""
    for run in stored_runs(storage.store):
        identity = _without(run.record.identity.json_values(), (*_RECORD_ONLY, "machine"))
        yield digest(identity), run.folder.name


def _without(identity: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    return {key: value for key, value in identity.items() if key not in keys}
