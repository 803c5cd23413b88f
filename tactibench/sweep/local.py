"""A cluster of processes on this machine."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tactibench.run.device import cuda_possible
from tactibench.run.fingerprint import fingerprint
from tactibench.sweep.dask_modules import dask_modules, quiet
from tactibench.sweep.engine import GPU, Engine

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that say with how many threads a process computes."""


def cores() -> int:
    """Logical cores that this process may use."""
    count: int = fingerprint()["cores_logical"]
    return count


@contextmanager
def local_engine(workers: int, threads: int, deaths: int) -> Iterator[Engine]:
    """A cluster of processes on this machine, each of which has one task at a time.

    threads: of a process. deaths: of workers that a task outlives. Raises UserError without dask.
    """
    dask, distributed = dask_modules()
    settings = {
        "distributed.scheduler.allowed-failures": deaths,
        "distributed.worker.daemon": False,
    }
    with dask.config.set(settings), quiet():
        cluster = distributed.SpecCluster(
            workers=_workers(distributed.Nanny, workers, threads),
            scheduler={
                "cls": distributed.Scheduler,
                "options": {
                    "protocol": "tcp://",
                    "host": "127.0.0.1",
                    "port": 0,
                    "dashboard": False,
                    "dashboard_address": None,
                },
            },
            silence_logs=logging.CRITICAL,
        )
        with cluster, distributed.Client(cluster) as client:
            yield Engine(client, remote=False)


def _workers(nanny: type, count: int, threads: int) -> dict[int, dict[str, Any]]:
    """Specifications of the processes; the first ones have a card each, as far as there are."""
    cards = _cards()
    found = {}
    for number in range(count):
        environment = dict.fromkeys(THREADS, str(threads))
        options: dict[str, Any] = {
            "host": "127.0.0.1",
            "nthreads": 1,
            "memory_limit": 0,
            "dashboard": False,
            "dashboard_address": None,
            "silence_logs": logging.CRITICAL,
            "env": environment,
        }
        if number < len(cards):
            environment["CUDA_VISIBLE_DEVICES"] = cards[number]
            options["resources"] = {GPU: 1}
        found[number] = {"cls": nanny, "options": options}
    return found


def _cards() -> list[str]:
    """Names for CUDA_VISIBLE_DEVICES of the cards that this process may use."""
    if not cuda_possible():
        return []
    import torch

    count = torch.cuda.device_count()
    named = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    return named[:count] if named else [str(number) for number in range(count)]
