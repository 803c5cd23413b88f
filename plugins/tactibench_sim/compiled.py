"""The decorator that compiles a loop, with one set of options for all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

COMPILED = ("C", "W")
"""Requirements on an array; one that is read-only or strided would compile the loops anew."""


def jit(function: Callable[..., Any]) -> Any:
    """Compile without the interpreter's lock, on the first call or from the cache on disk.

    The cache follows changes of the file of the function that is called. After editing a function
    that compiled code of another file calls, empty ``__pycache__``.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)
