"""One number of threads for everything that computes: torch, BLAS and OpenMP, OpenCV, numba."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tactibench.errors import UserError


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Let this process compute with ``count`` threads inside the block, and as before after it.

    OpenCV and numba are limited where they have been imported: by the time that a model is timed,
    everything that it computes with is imported.

    Raises:
        UserError: The block has changed torch's number of threads.
    """
    import torch
    from threadpoolctl import threadpool_limits

    cv2, numba = sys.modules.get("cv2"), sys.modules.get("numba")
    before = torch.get_num_threads()
    images = None if cv2 is None else cv2.getNumThreads()
    # Called after torch's: numba starts its threads now, which may change OpenMP's number.
    compiled = None if numba is None else numba.get_num_threads()
    try:
        with threadpool_limits(limits=count):
            torch.set_num_threads(count)
            if cv2 is not None:
                cv2.setNumThreads(count)
            if numba is not None:  # it refuses more threads than it was started with
                numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
            yield
            threads = torch.get_num_threads()
    finally:
        if numba is not None:
            numba.set_num_threads(compiled)
        if cv2 is not None:
            cv2.setNumThreads(images)
        torch.set_num_threads(before)
    if threads != count:
        raise UserError(
            f"the model set torch's threads to {threads} while it was timed with {count}, so that "
            "the times are of no known number of threads; take torch.set_num_threads out of it."
        )
