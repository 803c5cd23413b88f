"""Declares the model ``cnn``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    return [
        ModelSpec(
            name="cnn",
            target="tactibench_cnn.model:CNN",
            summary="convolutional regression from frame to one contact or plate pose",
            parameters=(
                Parameter("recipe", "default", "training recipe", choices=("default", "paper")),
                Parameter("width", 16, "channels of the first block", choices=(8, 16, 32, 64)),
                Parameter("size", 128, "frames are resized to this, px", choices=(64, 96, 128)),
                Parameter("epochs", 0, "epochs, 0: as many as the recipe has", low=0, high=1000),
                Parameter(
                    "precision",
                    "recipe",
                    "training arithmetic, recipe: as the recipe has it",
                    choices=("recipe", "auto", "float32", "bf16"),
                ),
            ),
            answers=("contacts", "plate"),
            max_contacts=1,
        )
    ]
