"""The decorator that compiles a loop, with one set of options for all, and what loops are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]


def plain(array: Array) -> Array:
    """Return the array, a copy where it is read-only or strided: loops are compiled for no such."""
    return np.require(array, requirements=("C", "W"))


def jit(function: Callable[..., Any]) -> Any:
    """Compile without the interpreter's lock, on the first call or from the cache on disk.

    The cache follows changes of the file of the function that is called. After editing a function
    that compiled code of another file calls, empty ``__pycache__``.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)
