"""Declaration of the model ``cnn``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the model ``cnn``."""
    return [
        ModelSpec(
            name="cnn",
            target="tactibench_cnn.model:CNN",
            summary="convolutional regression from frame to a contact, none, or a plate pose",
            parameters=(
                Parameter("recipe", "default", "training recipe", choices=("default", "paper")),
                Parameter("width", 16, "channels of the first block", choices=(8, 16, 32, 64)),
                Parameter("size", 128, "frames are resized to this, px", choices=(64, 96, 128)),
                *training_parameters(mixing=False),
            ),
            refinable=True,
            answers=("contacts", "plate"),
            max_contacts=1,
        )
    ]
