"""The decorator that compiles loops with one set of options, and the arrays that they take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]


def plain(array: Array) -> Array:
    """Return the array, or a contiguous writeable copy: loops are compiled for such arrays only."""
    return np.require(array, requirements=("C", "W"))


def jit(function: Callable[..., Any]) -> Any:
    """Compile a function to run without the interpreter's lock, on the first call or from cache.

    The cache on disk follows changes of the file of the function that is called. After editing a
    function that compiled code of another file calls, empty ``__pycache__``.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)
