"""Declaration of the model ``vgnn``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the model ``vgnn``."""
    return [
        ModelSpec(
            name="vgnn",
            target="tactibench_vgnn.model:VGNN",
            summary="graph network over the pins and their Voronoi cells, any number of contacts",
            parameters=(
                Parameter("width", 32, "features of a pin", choices=(16, 32, 64)),
                Parameter("layers", 4, "rounds of message passing", low=1, high=16),
                *training_parameters(mixing=True),
            ),
            refinable=True,
            answers=("contacts", "plate"),
        )
    ]
