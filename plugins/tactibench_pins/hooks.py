"""Declaration of the models ``kernel`` and ``pins``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters

_ANSWERS = ("contacts", "plate")
_READS = ("image", "channels")
_SITES = ("sites",)
_MIXING = Parameter(
    "mixing", True, "learn from sums of trials, too, where these touch half of the places at most"
)


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the models ``kernel`` and ``pins``."""
    return [
        ModelSpec(
            name="kernel",
            target="tactibench_pins.kernel:Kernel",
            summary="kernel regression of pins or channels: a contact, none, or a plate pose",
            parameters=(),
            refinable=True,
            answers=_ANSWERS,
            reads=_READS,
            max_contacts=1,
            deterministic=True,
            of_sites=ModelSpec(
                name="kernel",
                target="tactibench_pins.sites:KernelSites",
                summary="ridge regression of squashed channels",
                parameters=(_MIXING,),
                answers=_SITES,
                reads=("channels",),
            ),
        ),
        ModelSpec(
            name="pins",
            target="tactibench_pins.model:Pins",
            summary="networks over pins or the field of channels: a contact, none, or a plate pose",
            parameters=(
                Parameter("members", 4, "networks whose answers are averaged", low=1, high=32),
                Parameter("width", 256, "units of a layer", low=8, high=1024),
                *training_parameters(mixing=False),
            ),
            refinable=True,
            answers=_ANSWERS,
            reads=_READS,
            max_contacts=1,
            of_sites=ModelSpec(
                name="pins",
                target="tactibench_pins.sites:PinsSites",
                summary="averaged networks on components of squashed channels",
                parameters=(
                    Parameter("members", 4, "networks that are averaged", low=1, high=32),
                    Parameter("width", 128, "units of a layer", low=8, high=1024),
                    Parameter("epochs", 30, "epochs", low=1, high=1000),
                    _MIXING,
                ),
                answers=_SITES,
                reads=("channels",),
            ),
        ),
    ]
