"""A scheduler that is running already."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tactibench.errors import UserError
from tactibench.sweep.dask_modules import dask_modules, quiet
from tactibench.sweep.engine import Engine

PATIENCE_S = 3.0
"""Seconds until a scheduler that does not answer is unreachable."""


@contextmanager
def remote_engine(address: str) -> Iterator[Engine]:
    """The workers of a running scheduler. Raises UserError without dask or when it is not there."""
    _, distributed = dask_modules()
    with quiet():
        try:
            client = distributed.Client(address, timeout=PATIENCE_S)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            why = str(error).partition("\n")[0].rstrip(".") or type(error).__name__
            raise UserError(
                f"no scheduler answers at --scheduler {address} ({why}); give the address that "
                "`dask scheduler` prints, for example tcp://10.0.0.5:8786."
            ) from None
        with client:
            yield Engine(client, remote=True)
