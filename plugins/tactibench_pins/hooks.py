"""Declaration of the models ``kernel`` and ``pins``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters

_ANSWERS = ("contacts", "plate")
_READS = ("image", "channels")


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the models ``kernel`` and ``pins``."""
    return [
        ModelSpec(
            name="kernel",
            target="tactibench_pins.kernel:Kernel",
            summary="kernel regression of pins or channels: a contact, none, or a plate pose",
            parameters=(),
            answers=_ANSWERS,
            reads=_READS,
            max_contacts=1,
            deterministic=True,
        ),
        ModelSpec(
            name="pins",
            target="tactibench_pins.model:Pins",
            summary="averaged networks over pins or channels: a contact, none, or a plate pose",
            parameters=(
                Parameter("members", 4, "networks whose answers are averaged", low=1, high=32),
                Parameter("width", 256, "units of a layer", low=8, high=1024),
                *training_parameters(mixing=False),
            ),
            answers=_ANSWERS,
            reads=_READS,
            max_contacts=1,
        ),
    ]
