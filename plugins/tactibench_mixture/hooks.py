"""Declaration of the model ``mixture``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the model ``mixture``."""
    return [
        ModelSpec(
            name="mixture",
            target="tactibench_mixture.model:Mixture",
            summary="displacement field to a mixture of Gaussians, each contact with its std",
            parameters=(
                Parameter("width", 32, "channels of the finest level", choices=(16, 32, 48, 64)),
                *training_parameters(mixing=True),
            ),
            refinable=True,
            answers=("contacts", "plate"),
            uses_encoder=True,
            encoders=("mixture",),
            default_encoder="mixture",
        )
    ]
