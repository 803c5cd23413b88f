"""Declares the model ``mixture``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    return [
        ModelSpec(
            name="mixture",
            target="tactibench_mixture.model:Mixture",
            summary="displacement field to a mixture of Gaussians, each contact with its std",
            parameters=(
                Parameter("width", 32, "channels of the finest level", choices=(16, 32, 48, 64)),
                Parameter("cells", 16, "cells along a side of the frame", choices=(16, 32)),
                Parameter(
                    "mirror",
                    "auto",
                    "train on mirrored frames, auto: where the pins at rest are symmetric",
                    choices=("auto", "never"),
                ),
                Parameter("epochs", 0, "epochs, 0: as many as the recipe has", low=0, high=1000),
                Parameter(
                    "precision",
                    "recipe",
                    "training arithmetic, recipe: as the recipe has it",
                    choices=("recipe", "auto", "float32", "bf16"),
                ),
                Parameter(
                    "mixing",
                    0.0,
                    "extra multi-contact frames made from single presses, share of the presses",
                    low=0.0,
                    high=10.0,
                ),
            ),
            answers=("contacts", "plate"),
            uses_encoder=True,
            encoders=("mixture",),
            default_encoder="mixture",
        )
    ]
