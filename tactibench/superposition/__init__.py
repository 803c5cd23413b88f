"""Several contacts out of single presses: fields, load sharing, mixed frames. Public to plugins."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactibench.superposition.field import Field
    from tactibench.superposition.mixing import mix
    from tactibench.superposition.neighbours import Neighbours, shipped, shipped_inverse
    from tactibench.superposition.newton import Solution, solve
    from tactibench.superposition.picture import PinPicture
    from tactibench.superposition.presses import Eye, as_rows, single_presses
    from tactibench.superposition.remainder import Remainder

_HOME = {
    "Eye": "presses",
    "Field": "field",
    "Neighbours": "neighbours",
    "PinPicture": "picture",
    "Remainder": "remainder",
    "Solution": "newton",
    "as_rows": "presses",
    "mix": "mixing",
    "shipped": "neighbours",
    "shipped_inverse": "neighbours",
    "single_presses": "presses",
    "solve": "newton",
}

__all__ = [
    "Eye",
    "Field",
    "Neighbours",
    "PinPicture",
    "Remainder",
    "Solution",
    "as_rows",
    "mix",
    "shipped",
    "shipped_inverse",
    "single_presses",
    "solve",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
