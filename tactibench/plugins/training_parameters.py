"""The parameters that models trained by ``tactibench.training`` have in common."""

from __future__ import annotations

from tactibench.plugins.parameter import Parameter


def training_parameters(*, mixing: bool) -> tuple[Parameter, ...]:
    """Return the parameters that every model trained by ``tactibench.training`` has.

    Args:
        mixing: Whether the model can learn from frames with several contacts that are made from
            single presses.
    """
    epochs = Parameter("epochs", 0, "epochs, 0: as many as the recipe has", low=0, high=1000)
    precision = Parameter(
        "precision",
        "recipe",
        "training arithmetic, recipe: as the recipe has it",
        choices=("recipe", "auto", "float32", "bf16"),
    )
    mixed_frames = Parameter(
        "mixing",
        0.0,
        "extra multi-contact frames made from single presses, share of the presses",
        low=0,
        high=10,
    )
    return (epochs, precision, mixed_frames) if mixing else (epochs, precision)
