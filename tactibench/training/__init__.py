"""Training shared by the learned models: recipes, a resumable deterministic loop, safe weights.

Public to plugins. torch is imported inside the modules, and only when a name here is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactibench.training.examples import Examples, image_tensor
    from tactibench.training.fold import fold_batch_norm
    from tactibench.training.loop import train
    from tactibench.training.network import count_parameters, state_hash
    from tactibench.training.precision import autocast, resolve_precision
    from tactibench.training.recipe import RECIPES, Recipe
    from tactibench.training.seeds import Seeds, seeded
    from tactibench.training.weights import load_weights, save_weights

_HOME = {
    "RECIPES": "recipe",
    "Examples": "examples",
    "Recipe": "recipe",
    "Seeds": "seeds",
    "autocast": "precision",
    "count_parameters": "network",
    "fold_batch_norm": "fold",
    "image_tensor": "examples",
    "load_weights": "weights",
    "resolve_precision": "precision",
    "save_weights": "weights",
    "seeded": "seeds",
    "state_hash": "network",
    "train": "loop",
}

__all__ = [
    "RECIPES",
    "Examples",
    "Recipe",
    "Seeds",
    "autocast",
    "count_parameters",
    "fold_batch_norm",
    "image_tensor",
    "load_weights",
    "resolve_precision",
    "save_weights",
    "seeded",
    "state_hash",
    "train",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
