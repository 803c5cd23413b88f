"""Declaration of the model ``superpose``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the model ``superpose``."""
    return [
        ModelSpec(
            name="superpose",
            target="tactibench_superpose.model:Superpose",
            summary="least squares of single-press pin displacements that add up",
            parameters=(
                Parameter(
                    "neighbours",
                    "dome",
                    "what contacts do to each other: dome (mechanics of a nominal dome; fitted to "
                    "the training presses with several contacts where there are any), none",
                    choices=("dome", "none"),
                ),
                Parameter(
                    "gain",
                    1.2,
                    "a further contact must lower the squared misfit by this factor",
                    low=1.01,
                    high=100.0,
                ),
                Parameter("max_count", 6, "most contacts in a frame", low=1, high=16),
            ),
            max_contacts=None,
            deterministic=True,
            composes=True,
            of_sites=ModelSpec(
                name="superpose",
                target="tactibench_superpose.sites:SuperposeSites",
                summary="least squares of channel fields that add up",
                answers=("sites",),
                reads=("channels",),
                composes=True,
            ),
        )
    ]
