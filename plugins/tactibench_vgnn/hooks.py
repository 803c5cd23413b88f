"""Declares the model ``vgnn``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    return [
        ModelSpec(
            name="vgnn",
            target="tactibench_vgnn.model:VGNN",
            summary="graph network over the pins and their Voronoi cells, any number of contacts",
            parameters=(
                Parameter("width", 32, "features of a pin", choices=(16, 32, 64)),
                Parameter("layers", 4, "rounds of message passing", low=1, high=16),
                Parameter(
                    "graph",
                    "rest",
                    "who is whose neighbour, rest: in the undeformed sensor, frame: in each frame",
                    choices=("rest", "frame"),
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
                    "frames with several contacts made from single presses, as a share of them",
                    low=0.0,
                    high=4.0,
                ),
            ),
            answers=("contacts", "plate"),
        )
    ]
