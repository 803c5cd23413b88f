"""The workers of a dask.distributed cluster: processes of this machine, or a running scheduler."""

from __future__ import annotations

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from tactibench.errors import UserError
from tactibench.records import cache_folder
from tactibench.run import cuda_possible, fingerprint, software

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

_MANY = 1_000_000
"""Capacity of a remote scheduler, more than a sweep has cells: it is given all tasks at once."""

T = TypeVar("T")
R = TypeVar("R")


class WorkerLossError(Exception):
    """The workers that were given a task died, more often than is allowed."""


@dataclass(frozen=True)
class Capacity:
    """Numbers of tasks that can begin at once.

    Attributes:
        slots: Number of tasks of any kind.
        gpus: Number of tasks that need a graphics card.
    """

    slots: int
    gpus: int


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


class Cluster:
    """Tasks on the workers of a dask client.

    Args:
        client: The client.
        remote: Whether the workers are processes that somebody else started.
    """

    def __init__(self, client: Any, *, remote: bool) -> None:
        self.client = client
        self.remote = remote

    def capacity(self) -> Capacity:
        """Return the capacity of the present workers.

        A remote scheduler is given all tasks at once: its workers come and go, and some are only
        started where work is waiting.
        """
        workers = self.workers().values()
        slots = sum(worker["nthreads"] for worker in workers)
        gpus = sum(int(worker["resources"].get(GPU, 0)) for worker in workers)
        if self.remote:
            return Capacity(_MANY, _MANY if gpus or not slots else 0)
        return Capacity(slots, gpus)

    def workers(self) -> Mapping[str, Any]:
        """Return address -> facts of every worker.

        Raises:
            UserError: The scheduler has gone.
        """
        if self.client.status not in ("running", "connecting"):
            raise _lost_connection()
        workers: Mapping[str, Any] = self.client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def submit(self, work: Callable[..., Any], *arguments: Any, gpu: bool = False) -> Any:
        """Begin a task; its future goes to ``wait_any`` and ``result``."""
        resources = {GPU: 1} if gpu else None
        return self.client.submit(work, *arguments, resources=resources, pure=False)

    def wait_any(self, futures: Iterable[Any], seconds: float = 1.0) -> list[Any]:
        """Return the futures that have finished, after one has or the seconds are over.

        Raises:
            UserError: The scheduler has gone.
        """
        import distributed

        distributed_wait: Callable[..., object] = distributed.wait
        waiting = list(futures)
        if not waiting:  # all workers have died, new ones are being started
            time.sleep(0.1)
        with suppress(distributed.TimeoutError):
            distributed_wait(waiting, timeout=seconds, return_when="FIRST_COMPLETED")
        self.workers()
        return [future for future in waiting if future.done()]

    def wait(self, future: Any) -> Any:
        """Wait until a task has finished and return its ``result``."""
        while not self.wait_any([future]):
            pass
        return self.result(future)

    def result(self, future: Any) -> Any:
        """Return the result of a finished task.

        Raises:
            WorkerLossError: The workers died.
            UserError: The scheduler has gone.
            Exception: Whatever the task raised.
        """
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            return future.result()
        except KilledWorker:
            raise WorkerLossError from None
        except FutureCancelledError:
            raise _lost_connection() from None

    def map_in_order(self, work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """Yield ``map(work, items)``, a few results ahead; raise as ``result``."""
        rest = iter(items)
        waiting: deque[Any] = deque()
        try:
            while True:
                room = max(0, self._prefetch() - len(waiting))
                waiting.extend(self.submit(work, item) for item in islice(rest, room))
                if not waiting:
                    return
                yield self.wait(waiting.popleft())
        finally:
            self.client.cancel(list(waiting))

    def _prefetch(self) -> int:
        """Return how many results of ``map_in_order`` may wait in memory or be in the making."""
        return 1 + 2 * sum(int(worker["nthreads"]) for worker in self.workers().values())


def count_cores() -> int:
    """Return the logical cores that this process may use."""
    count: int = fingerprint()["cores_logical"]
    return count


@contextmanager
def local_cluster(workers: int, threads: int, deaths: int) -> Iterator[Cluster]:
    """Start processes on this machine, each of which has one task at a time.

    They talk by TLS with a key that is made for this call and stays in memory. Without a key,
    whoever reaches the port of the scheduler, such as another user of this machine, could run code
    on the workers.

    Args:
        workers: Number of processes.
        threads: Number of threads of a process.
        deaths: Number of deaths of workers after which a task is still tried again.

    Raises:
        UserError: dask or cryptography is not installed.
    """
    dask, distributed = _import_dask()
    try:
        security = distributed.Security.temporary()
    except ImportError:
        raise UserError(
            "the processes of a sweep talk by keys that the package cryptography makes, which is "
            "not installed; `pip install 'tactibench[sweep]'`."
        ) from None
    settings = {
        "distributed.scheduler.allowed-failures": deaths,
        "distributed.worker.daemon": False,
        # Both have a web server, which cannot be left out; without routes it shows nothing.
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    scheduler = {
        "protocol": "tls://",
        "security": security,
        "host": "127.0.0.1",
        "port": 0,
        "dashboard": False,
        "dashboard_address": LOCAL_PAGE,
    }
    with dask.config.set(settings), _quiet_log():
        cluster = distributed.SpecCluster(
            workers=_local_workers(distributed.Nanny, workers, threads, security),
            scheduler={"cls": distributed.Scheduler, "options": scheduler},
            security=security,
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster) as client:
            yield Cluster(client, remote=False)


@contextmanager
def remote_cluster(address: str, storage: Storage) -> Iterator[Cluster]:
    """Connect to a running scheduler, and check its workers as ``check_workers`` does.

    Raises:
        UserError: dask is not installed, the scheduler does not answer, or a worker cannot import
            tactibench, does not see a folder, or has other software than this machine.
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
            cluster = Cluster(client, remote=True)
            check_workers(cluster, storage)
            yield cluster


@dataclass(frozen=True)
class _WorkerView:
    """The folders that a worker does not see, and the software that it runs: name -> version."""

    missing: tuple[str, ...]
    software: Mapping[str, str]


def check_workers(cluster: Cluster, storage: Storage) -> None:
    """Wait for a worker, then check that all workers see the folders and run this software.

    Raises:
        UserError: A worker cannot import tactibench, does not see a folder, or has other software
            than this machine.
    """
    with _mark(storage.store) as store, _mark(storage.cache) as cache:
        marks = {"run store": store, "cache": cache}
        # Schedulers that start workers on demand start one for a task.
        future = cluster.submit(_view_worker, marks)
        while not cluster.wait_any([future]):
            pass
        cluster.client.cancel([future])
        answers = cluster.client.run(_view_worker, marks, on_error="return")
    here = software()
    for address, view in answers.items():
        if isinstance(view, Exception):
            raise UserError(
                f"worker {address} cannot import this tactibench ({type(view).__name__}: {view}); "
                "install it where the worker runs."
            )
        if view.missing:
            name, folder = view.missing[0], Path(marks[view.missing[0]]).parent
            option = "--store" if name == "run store" else "TACTIBENCH_CACHE"
            raise UserError(
                f"worker {address} does not see the {name} {folder}; name a folder that all "
                f"machines share with {option}."
            )
        for name in {**here, **view.software}:
            there, ours = (have.get(name, "not installed") for have in (view.software, here))
            if there != ours:
                raise UserError(
                    f"worker {address} has {name} {there}, this machine has {name} {ours}; install "
                    "the same on both."
                )


def _view_worker(marks: dict[str, str]) -> _WorkerView:
    missing = tuple(name for name, mark in marks.items() if not Path(mark).is_file())
    return _WorkerView(missing, software())


@contextmanager
def _mark(folder: Path) -> Iterator[str]:
    """Put a file into a folder while the block runs; a folder that was made for it goes, too."""
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    mark = folder / f".sweep-{os.getpid()}"
    mark.touch()
    try:
        yield str(mark)
    finally:
        mark.unlink(missing_ok=True)
        if new:
            with suppress(OSError):
                folder.rmdir()


def _local_workers(
    nanny: type, count: int, threads: int, security: Any
) -> dict[int, dict[str, Any]]:
    """Return the options of the processes; the first ones have a graphics card each."""
    cards = _graphics_cards()
    # A worker's files on the disk are read as code, so they must not lie in a shared folder.
    folder = cache_folder().resolve() / "workers"
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    workers = {}
    for number in range(count):
        environment = dict.fromkeys(THREADS, str(threads))
        options: dict[str, Any] = {
            "host": "127.0.0.1",
            "protocol": "tls://",
            "security": security,
            "local_directory": str(folder),
            "nthreads": 1,
            "memory_limit": 0,
            "dashboard": False,
            "dashboard_address": LOCAL_PAGE,
            "silence_logs": logging.CRITICAL,
            "env": environment,
        }
        if number < len(cards):
            environment["CUDA_VISIBLE_DEVICES"] = cards[number]
            options["resources"] = {GPU: 1}
        workers[number] = {"cls": nanny, "options": options}
    return workers


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
        UserError: dask.distributed is not installed.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise UserError(
            "sweeps are run by dask.distributed, which is not installed; "
            "`pip install 'tactibench[sweep]'`."
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


def _lost_connection() -> UserError:
    return UserError(
        "the connection to the scheduler was lost; finished runs are kept, the same command "
        "continues."
    )
