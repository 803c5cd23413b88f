"""Parameters that models of several plugins share, so that they mean the same in each."""

from __future__ import annotations

from tactibench.plugins.specs import Parameter


def training_parameters(*, mixing: bool) -> tuple[Parameter, ...]:
    """What every model trained by ``tactibench.training`` can be told: epochs and precision.

    mixing: whether it can learn from frames with several contacts made from single presses.
    """
    shared = (
        Parameter("epochs", 0, "epochs, 0: as many as the recipe has", low=0, high=1000),
        Parameter(
            "precision",
            "recipe",
            "training arithmetic, recipe: as the recipe has it",
            choices=("recipe", "auto", "float32", "bf16"),
        ),
    )
    made = Parameter(
        "mixing",
        0.0,
        "extra multi-contact frames made from single presses, share of the presses",
        low=0,
        high=10,
    )
    return (*shared, made) if mixing else shared
