"""Training shared by the learned models: recipes, a resumable deterministic loop, safe weights.

Public to plugins. torch is imported inside the modules, and only when a name here is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactibench.training.calibration import held_back, scale_std, std_factors
    from tactibench.training.examples import Examples, image_tensor, resting_frames
    from tactibench.training.fold import fold_batch_norm
    from tactibench.training.learned import LearnedModel
    from tactibench.training.loop import train
    from tactibench.training.mirror import mirrored, own_mirror, random_turns
    from tactibench.training.mixture import (
        MixtureScale,
        count_nll,
        mixture_loss,
        mixture_values,
        pack_contacts,
    )
    from tactibench.training.mixture_model import MixtureModel
    from tactibench.training.mixture_reading import FAINT, MixtureReader, read_mixture
    from tactibench.training.network import count_parameters, state_hash
    from tactibench.training.packed import pack_image, unpack_image
    from tactibench.training.precision import autocast, resolve_precision
    from tactibench.training.recipe import RECIPES, Recipe
    from tactibench.training.regression import (
        ANSWER_WIDTH,
        Normalisation,
        answer_vectors,
        regressable,
        vector_answers,
    )
    from tactibench.training.seeds import Seeds, seeded
    from tactibench.training.targets import PlateScale, heatmaps, position_error_mm
    from tactibench.training.weights import load_weights, save_weights

_HOME = {
    "random_turns": "mirror",
    "own_mirror": "mirror",
    "mirrored": "mirror",
    "FAINT": "mixture_reading",
    "RECIPES": "recipe",
    "Examples": "examples",
    "LearnedModel": "learned",
    "MixtureModel": "mixture_model",
    "MixtureReader": "mixture_reading",
    "MixtureScale": "mixture",
    "PlateScale": "targets",
    "ANSWER_WIDTH": "regression",
    "Normalisation": "regression",
    "answer_vectors": "regression",
    "regressable": "regression",
    "resting_frames": "examples",
    "vector_answers": "regression",
    "Recipe": "recipe",
    "Seeds": "seeds",
    "autocast": "precision",
    "count_nll": "mixture",
    "count_parameters": "network",
    "fold_batch_norm": "fold",
    "heatmaps": "targets",
    "held_back": "calibration",
    "image_tensor": "examples",
    "load_weights": "weights",
    "mixture_loss": "mixture",
    "mixture_values": "mixture",
    "pack_contacts": "mixture",
    "pack_image": "packed",
    "position_error_mm": "targets",
    "read_mixture": "mixture_reading",
    "resolve_precision": "precision",
    "save_weights": "weights",
    "scale_std": "calibration",
    "seeded": "seeds",
    "state_hash": "network",
    "std_factors": "calibration",
    "train": "loop",
    "unpack_image": "packed",
}

__all__ = [
    "ANSWER_WIDTH",
    "FAINT",
    "RECIPES",
    "Examples",
    "LearnedModel",
    "MixtureModel",
    "MixtureReader",
    "MixtureScale",
    "Normalisation",
    "PlateScale",
    "Recipe",
    "Seeds",
    "answer_vectors",
    "autocast",
    "count_nll",
    "count_parameters",
    "fold_batch_norm",
    "heatmaps",
    "held_back",
    "image_tensor",
    "load_weights",
    "mirrored",
    "mixture_loss",
    "mixture_values",
    "own_mirror",
    "pack_contacts",
    "pack_image",
    "position_error_mm",
    "random_turns",
    "read_mixture",
    "regressable",
    "resolve_precision",
    "resting_frames",
    "save_weights",
    "scale_std",
    "seeded",
    "state_hash",
    "std_factors",
    "train",
    "unpack_image",
    "vector_answers",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
