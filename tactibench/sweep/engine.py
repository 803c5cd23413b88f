"""Tasks on the workers of a dask.distributed cluster."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from tactibench.errors import UserError

GPU = "GPU"
"""The resource of workers with a graphics card: ``dask worker --resources GPU=1``."""
NO_GPU = (
    f'device is "cuda", but no worker has the resource {GPU}; start one with '
    f"`dask worker ADDRESS --nthreads 1 --resources {GPU}=1`."
)

MANY = 1_000_000

T = TypeVar("T")
R = TypeVar("R")


class WorkersDied(Exception):  # noqa: N818 - a fact about the cluster
    """The workers that were given a task died, more often than is borne."""


@dataclass(frozen=True)
class Room:
    """How many tasks there is room for at once; gpus: of those that need a card."""

    slots: int
    gpus: int


class Engine:
    """Tasks on the workers of a client. remote: whether they are others' processes."""

    def __init__(self, client: Any, *, remote: bool) -> None:
        self.client = client
        self.remote = remote

    def room(self) -> Room:
        """Of the workers that are there now. A remote scheduler is handed everything at once: its
        workers come and go, and some are only started where work is waiting."""
        workers = self.workers().values()
        slots = sum(worker["nthreads"] for worker in workers)
        gpus = sum(int(worker["resources"].get(GPU, 0)) for worker in workers)
        return Room(MANY, MANY if gpus or not slots else 0) if self.remote else Room(slots, gpus)

    def workers(self) -> Mapping[str, Any]:
        """Address -> facts. Raises UserError when the scheduler has gone."""
        if self.client.status not in ("running", "connecting"):
            raise _gone()
        found: Mapping[str, Any] = self.client.scheduler_info(n_workers=-1)["workers"]
        return found

    def submit(self, work: Callable[..., Any], *arguments: Any, gpu: bool = False) -> Any:
        """Begin a task; its future goes to ``any_of`` and ``result``."""
        resources = {GPU: 1} if gpu else None
        return self.client.submit(work, *arguments, resources=resources, pure=False)

    def any_of(self, futures: Iterable[Any], seconds: float = 1.0) -> list[Any]:
        """Those that have finished, after one has or the seconds are over.

        Raises UserError when the scheduler has gone.
        """
        import distributed

        distributed_wait: Callable[..., object] = distributed.wait
        waited = list(futures)
        if not waited:  # all workers have died, new ones are being started
            time.sleep(0.1)
        with suppress(distributed.TimeoutError):
            distributed_wait(waited, timeout=seconds, return_when="FIRST_COMPLETED")
        self.workers()
        return [future for future in waited if future.done()]

    def result(self, future: Any) -> Any:
        """Of a finished task. Raises WorkersDied, UserError, or what the task raised."""
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            return future.result()
        except KilledWorker:
            raise WorkersDied from None
        except FutureCancelledError:
            raise _gone() from None

    def _ahead(self) -> int:
        """How many results of ``in_order`` may wait in memory or be in the making."""
        return 1 + 2 * sum(int(worker["nthreads"]) for worker in self.workers().values())

    def in_order(self, work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """``map(work, items)`` on the workers, not far ahead of who takes the results.

        Raises what ``result`` raises.
        """
        rest = iter(items)
        waiting: deque[Any] = deque()
        try:
            while True:
                room = max(0, self._ahead() - len(waiting))
                waiting.extend(self.submit(work, item) for item in islice(rest, room))
                if not waiting:
                    return
                first = waiting.popleft()
                while not self.any_of([first]):
                    pass
                yield self.result(first)
        finally:
            self.client.cancel(list(waiting))


def _gone() -> UserError:
    return UserError(
        "the connection to the scheduler was lost; finished runs are kept, the same command "
        "continues."
    )
