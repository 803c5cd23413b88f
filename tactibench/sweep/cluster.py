"""The runs of a sweep on a dask.distributed cluster: of this machine, or of a running scheduler.

dask hands out tasks, holds back the runs that wait for a shared training, and repeats the task of a
worker that died.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tactibench.errors import UserError, describe_exception, printable
from tactibench.frames import FramePlan
from tactibench.plugins import PluginHost, describe_failure
from tactibench.records import (
    CHECKSUM,
    cache_folder,
    digest,
    open_run,
    readable_run,
    stored_runs,
)
from tactibench.run import (
    NullReporter,
    Reporter,
    RunPlan,
    RunRequest,
    cuda_possible,
    execute,
    make_plan,
    software,
    train_model,
)
from tactibench.sweep.cells import Cell

GPU = "GPU"
"""The resource of workers with a graphics card: ``dask worker --resources GPU=1``."""
NO_GPU = (
    f'device is "cuda", but no worker has the resource {GPU}; start one with '
    f"`dask worker ADDRESS --nthreads 1 --resources {GPU}=1`."
)
PATIENCE_S = 3.0
"""Seconds until a scheduler that does not answer counts as unreachable."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that say with how many threads a process computes."""
LOCAL_PAGE = "127.0.0.1:0"
"""Address of dask's web server: any free port, since 8787, the default, may be another sweep's."""

STATES = ("in the store", "run", "to do", "failed")
"""States of a cell, in the order in which summaries count them."""

_RECORD_ONLY = ("commit", "data", "weights_hash", "predictions_hash", "stored", CHECKSUM)
"""Keys of a record's identity that the identity of its plan does not have."""


@dataclass(frozen=True)
class Storage:
    """Folders of a sweep.

    Attributes:
        store: The run store.
        cache: The cache, whose contents can be made again.
        any_machine: Whether a run that another machine made counts, as it must where a cell may
            run on one of several machines.
    """

    store: Path
    cache: Path
    any_machine: bool = False


@dataclass(frozen=True)
class CellState:
    """The state of a cell before or after it ran.

    Attributes:
        state: One of ``STATES``.
        name: Name of the run; "" where it failed.
        why: Sentence that says why it failed or cannot be run.
        seconds: Time that it took, s; None: it was not run.
        weights: Key of the weights; cells with the same key share one training.
        trained: Whether these weights are in the cache.
    """

    state: Literal["in the store", "run", "to do", "failed"]
    name: str = ""
    why: str = ""
    seconds: float | None = None
    weights: str = ""
    trained: bool = False


@contextmanager
def local_client(workers: int, threads: int, deaths: int) -> Iterator[Any]:
    """Start processes on this machine, each of which has one task at a time.

    They talk by TLS with a key that is made for this call and stays in memory. Without a key,
    whoever reaches the port of the scheduler, such as another user of this machine, could run code
    on the workers.

    Args:
        workers: Number of processes; the first ones have a graphics card each.
        threads: Number of threads of a process.
        deaths: Number of deaths of workers after which a task is still tried again.

    Raises:
        UserError: dask or cryptography is not installed.
    """
    dask, distributed = _import_dask()
    security = distributed.Security.temporary()
    # A worker's files on the disk are read as code, so they must not lie in a shared folder.
    folder = cache_folder().resolve() / "workers"
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    shared = {
        "protocol": "tls://",
        "security": security,
        "host": "127.0.0.1",
        "dashboard": False,
        "dashboard_address": LOCAL_PAGE,
    }
    cards = _graphics_cards()
    specs: dict[int, dict[str, Any]] = {}
    for number in range(workers):
        environment = dict.fromkeys(THREADS, str(threads))
        options = {
            **shared,
            "local_directory": str(folder),
            "nthreads": 1,
            "memory_limit": 0,
            "silence_logs": logging.CRITICAL,
            "env": environment,
        }
        if number < len(cards):
            environment["CUDA_VISIBLE_DEVICES"] = cards[number]
            options["resources"] = {GPU: 1}
        specs[number] = {"cls": distributed.Nanny, "options": options}
    settings = {
        "distributed.scheduler.allowed-failures": deaths,
        # A worker that dies is blamed for the one task that it has.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.worker.daemon": False,
        # Both have a web server, which cannot be left out; without routes it shows nothing.
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    with dask.config.set(settings), _quiet_log():
        cluster = distributed.SpecCluster(
            workers=specs,
            scheduler={"cls": distributed.Scheduler, "options": {**shared, "port": 0}},
            security=security,
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster) as client:
            yield client


@contextmanager
def remote_client(address: str, storage: Storage) -> Iterator[Any]:
    """Connect to a running scheduler, wait for a worker, and check all that there are.

    Raises:
        UserError: dask is not installed, the scheduler does not answer, or a worker does not see
            the folders or has other software than this machine.
    """
    _, distributed = _import_dask()
    with _quiet_log():
        try:
            client = distributed.Client(address, timeout=PATIENCE_S)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            why = str(error).partition("\n")[0].rstrip(".") or type(error).__name__
            raise UserError(
                f"no scheduler answers at --scheduler {address} ({why}); give the address that "
                "`dask scheduler` prints, for example tcp://10.0.0.5:8786."
            ) from None
        with client:
            _check_workers(client, storage)
            yield client


def _check_workers(client: Any, storage: Storage) -> None:
    marks = [folder / f".sweep-{os.getpid()}" for folder in (storage.store, storage.cache)]
    try:
        for mark in marks:
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()
        # Schedulers that start workers on demand start one for a task.
        list(_finished(client, [client.submit(_view_worker, marks, pure=False)]))
        answers = client.run(_view_worker, marks, on_error="return")
    finally:
        for mark in marks:
            mark.unlink(missing_ok=True)
    here = software()
    for address, there in answers.items():
        if there != here:
            names = {**here, **there} if isinstance(there, dict) else {}
            differing = [name for name in names if there.get(name) != here.get(name)]
            raise UserError(
                f"worker {address} has another {', '.join(differing) or 'installation'} than this "
                f"machine, or does not see the run store and the cache ({there}); install the same "
                "software on both, and name shared folders with --store and TACTIBENCH_CACHE."
            )


def _view_worker(marks: Sequence[Path]) -> dict[str, str] | str:
    """Return name -> version of a worker's software, or the folder that it does not see."""
    missing = [str(mark.parent) for mark in marks if not mark.is_file()]
    return f"{missing[0]} is not there" if missing else software()


def _graphics_cards() -> list[str]:
    """Return the names for CUDA_VISIBLE_DEVICES of the cards that this process may use."""
    if not cuda_possible():
        return []
    import torch

    count = torch.cuda.device_count()
    named = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    return named[:count] if named else [str(number) for number in range(count)]


def _import_dask() -> tuple[Any, Any]:
    """Return the modules ``dask`` and ``distributed``.

    Raises:
        UserError: dask.distributed, or cryptography for its keys, is not installed.
    """
    try:
        import cryptography  # noqa: F401 - dask makes keys with it
        import dask
        import distributed
    except ImportError:
        raise UserError(
            "sweeps are run by dask.distributed with keys of cryptography, and one of them is not "
            "installed; `pip install 'tactibench[sweep]'`."
        ) from None
    return dask, distributed


@contextmanager
def _quiet_log() -> Iterator[None]:
    """Silence dask's log while the block runs: errors are reported in sentences."""
    log = logging.getLogger("distributed")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def _finished(client: Any, futures: Iterable[Any]) -> Iterator[Any]:
    """Yield futures as they finish.

    Raises:
        UserError: The scheduler has gone.
    """
    import distributed

    wait: Callable[..., Any] = distributed.wait
    waiting = list(futures)
    while waiting:
        with suppress(distributed.TimeoutError):
            wait(waiting, timeout=1.0, return_when="FIRST_COMPLETED")
        if client.status not in ("running", "connecting"):
            raise UserError(
                "the connection to the scheduler was lost; finished runs are kept, the same "
                "command continues."
            )
        # Each is asked once: one that ends between two questions would be forgotten.
        finished = [future for future in waiting if future.done()]
        waiting = [future for future in waiting if future not in finished]
        yield from finished


def _has_gpu(client: Any) -> bool:
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    return any(GPU in worker["resources"] for worker in workers)


def _resources(request: RunRequest) -> dict[str, int] | None:
    return {GPU: 1} if request.device == "cuda" else None


def plan_cells(
    cells: Iterable[Cell], storage: Storage, client: Any = None
) -> dict[Cell, CellState]:
    """Look up the state of all cells, on workers where there is a client, else in this process.

    Cells that need a graphics card are looked up on a worker that has one. Where several cells are
    the same run, only the first one stays.

    Raises:
        UserError: The scheduler has gone.
    """
    by_device: dict[str, list[Cell]] = {}
    for cell in cells:
        by_device.setdefault(cell.request.device, []).append(cell)
    states: dict[Cell, CellState] = {}
    names: set[str] = set()
    for device, some in by_device.items():
        requests = [cell.request for cell in some]
        if client is None:
            planned = plan_requests(requests, storage)
        elif device == "cuda" and not _has_gpu(client):
            planned = (CellState("failed", why=NO_GPU),) * len(some)
        else:
            resources = _resources(some[0].request)
            task = client.submit(plan_requests, requests, storage, resources=resources, pure=False)
            (future,) = _finished(client, [task])
            planned = future.result()
        for cell, state in zip(some, planned, strict=True):
            if not state.name or state.name not in names:
                states[cell] = state
                names.add(state.name)
    return states


def plan_requests(requests: Sequence[RunRequest], storage: Storage) -> tuple[CellState, ...]:
    """Return the states of runs, looked up in the store and the cache of this machine."""
    host = PluginHost()
    runs = dict(_runs_by_identity(storage)) if storage.any_machine else {}
    frame_plans: dict[str, FramePlan] = {}

    def plan_one(request: RunRequest) -> CellState:
        try:
            plan = make_plan(request, host, storage.cache, frame_plans)
        except (UserError, OSError) as error:
            return CellState("failed", why=printable(" ".join(str(error).split())))
        name = plan.name if readable_run(storage.store, plan.name) is not None else ""
        name = name or runs.get(digest(_without(plan.identity, ("machine",))), "")
        return CellState(
            "in the store" if name else "to do",
            name or plan.name,
            weights=plan.weights.folder.name,
            trained=plan.weights.cached,
        )

    return tuple(map(plan_one, requests))


def _runs_by_identity(storage: Storage) -> Iterator[tuple[str, str]]:
    """Yield, for every stored run, the hash of its identity without the machine, and its name."""
    for run in stored_runs(storage.store):
        identity = _without(run.record.identity.json_values(), (*_RECORD_ONLY, "machine"))
        yield digest(identity), run.folder.name


def _without(identity: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    return {key: value for key, value in identity.items() if key not in keys}


def run_cells(
    states: Mapping[Cell, CellState], client: Any, storage: Storage, reporter: Reporter
) -> dict[Cell, CellState]:
    """Run the cells that are to do; cells that share weights wait for one training.

    Raises:
        UserError: The scheduler has gone.
    """
    after = dict(states)
    groups: dict[str, list[Cell]] = {}
    has_gpu = _has_gpu(client)
    for cell, state in states.items():
        if state.state == "to do" and cell.request.device == "cuda" and not has_gpu:
            after[cell] = CellState("failed", why=NO_GPU)
        elif state.state == "to do":
            groups.setdefault(state.weights, []).append(cell)
    futures: dict[Any, Cell] = {}
    for cells in groups.values():
        training = None
        if len(cells) > 1 and not states[cells[0]].trained:
            training = _submit(client, train_weights, cells[0].request, storage)
        for cell in cells:
            futures[_submit(client, run_cell, cell.request, storage, training)] = cell
    with reporter.task("runs", len(futures)) as advance:
        for future in _finished(client, futures):
            after[futures[future]] = _result(future)
            advance(1)
    return after


def _submit(client: Any, work: Callable[..., CellState], request: RunRequest, *more: Any) -> Any:
    return client.submit(work, request, *more, resources=_resources(request), pure=False)


def _result(future: Any) -> CellState:
    from distributed import KilledWorker

    try:
        state: CellState = future.result()
    except KilledWorker:
        why = (
            "the workers that ran it died one after the other (killed, out of memory, or crashed); "
            "run it alone to see why."
        )
        return CellState("failed", why=why)
    except Exception as error:  # noqa: BLE001 - what a worker cannot even begin
        why = f"the worker could not do it ({describe_exception(error)})."
        return CellState("failed", why=why)
    return state


def train_weights(request: RunRequest, storage: Storage) -> CellState:
    """Train the weights of a cell, if they are not in the cache."""
    return _attempt(lambda plan: train_model(plan, NullReporter()), request, storage)


def run_cell(request: RunRequest, storage: Storage, training: CellState | None = None) -> CellState:
    """Run a cell and store it; a run that is stored is not run again.

    A worker may have died after it stored the run and before it reported it, and another sweep may
    use the same store.

    Args:
        request: The run.
        storage: Folders of the sweep.
        training: The training of its weights; its failure is passed on.
    """
    if training is not None and training.why:
        return training
    return _attempt(lambda plan: execute(plan, NullReporter()), request, storage)


def _attempt(work: Callable[[RunPlan], object], request: RunRequest, storage: Storage) -> CellState:
    began = time.perf_counter()
    try:
        plan = make_plan(request, PluginHost(), storage.cache, store=storage.store)
        work(plan)
    except (UserError, OSError) as error:
        why = printable(" ".join(str(error).split()))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin's
        why = describe_failure(error) or f"it raised {describe_exception(error).rstrip('.:')}."
    else:
        return CellState("run", plan.name, seconds=time.perf_counter() - began)
    return CellState("failed", why=why, seconds=time.perf_counter() - began)


def result_rows(states: Mapping[Cell, CellState], store: Path) -> list[dict[str, Any]]:
    """Return rows of metric, group, value, unit.

    They hold every metric of every run in the store, and "failed" for every cell that failed.

    Raises:
        UserError: A run is gone or cannot be read.
    """
    rows: list[dict[str, Any]] = []
    for cell, state in states.items():
        axes = {**cell.axes, "seed": cell.request.seed}
        if state.why:
            failed = {"metric": "failed", "group": cell.label, "value": 1, "unit": ""}
            rows.append({**failed, "why": state.why, **axes})
        elif state.state != "to do":
            for metric in open_run(store, state.name).record.metrics:
                row = metric.model_dump(include={"metric", "group", "value", "unit"})
                rows.append({**row, "run": state.name, **axes})
    return rows
