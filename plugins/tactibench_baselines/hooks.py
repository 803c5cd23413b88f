"""Declarations of the models ``mean`` and ``nearest``."""

from __future__ import annotations

from tactibench import ModelSpec, Parameter, hookimpl

_READS = ("image", "channels")


@hookimpl
def tactibench_models() -> list[ModelSpec]:
    """Declare the models."""
    return [
        ModelSpec(
            "mean",
            "tactibench_baselines.nearest:MeanModel",
            "trivial baseline: answers the training mean, whatever the frame",
            answers=("contacts", "plate", "sites"),
            reads=_READS,
            max_contacts=1,
            deterministic=True,
        ),
        ModelSpec(
            "nearest",
            "tactibench_baselines.nearest:NearestModel",
            "trivial baseline: answers the truth of the most similar training frame",
            (
                Parameter(
                    "size",
                    32,
                    "frames are compared as size x size pixels, averaged down",
                    low=4,
                    high=256,
                ),
            ),
            answers=("contacts", "plate", "sites"),
            reads=_READS,
            deterministic=True,
        ),
    ]
