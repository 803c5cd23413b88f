"""Every library computes with the threads that are asked for, and as before afterwards."""

from __future__ import annotations

import cv2
import numba
import pytest
import torch
from threadpoolctl import threadpool_info

from tactibench.errors import UserError
from tactibench.run import limited_threads


def counts() -> dict[str, int]:
    pools = {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}
    own = {"torch": torch.get_num_threads(), "cv2": cv2.getNumThreads()}
    return {**pools, **own, "numba": numba.get_num_threads()}


def test_torch_blas_opencv_and_numba_alike():
    counts()  # numba starts its threads when it is asked for the first time
    torch.set_num_threads(2)
    before = counts()
    with limited_threads(1):
        assert set(counts().values()) == {1}
    assert counts() == before


def test_more_threads_than_numba_has_are_those_that_it_has():
    most = numba.config.NUMBA_NUM_THREADS
    with limited_threads(most + 1):
        assert torch.get_num_threads() == most + 1
        assert numba.get_num_threads() == most


def test_all_are_restored_where_the_model_changed_them():
    before = counts()
    with pytest.raises(UserError, match="set torch's threads to 3"), limited_threads(1):
        torch.set_num_threads(3)
    assert counts() == before
