"""dask, where it is installed, and without its log."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tactibench.errors import UserError


def dask_modules() -> tuple[Any, Any]:
    """``dask`` and ``distributed``. Raises UserError where they are not installed."""
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
def quiet() -> Iterator[None]:
    """What goes wrong is said in sentences; dask's log of it is not for a user."""
    log = logging.getLogger("distributed")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)
