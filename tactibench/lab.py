"""Services of the core for plugins that work with devices: planned presses and trained models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactibench.datasets import Press, PressPlan, plan_presses, press_rows
from tactibench.errors import did_you_mean
from tactibench.frames import spread
from tactibench.protocols import parse_toml
from tactibench.records import atomic
from tactibench.run import open_weights

if TYPE_CHECKING:
    from tactibench.plugins import Model

__all__ = [
    "Press",
    "PressPlan",
    "atomic",
    "did_you_mean",
    "open_weights",
    "parse_toml",
    "plan_presses",
    "press_rows",
    "spread",
    "trained_model",
]


def trained_model(
    name: str,
    protocol: str = "exp1",
    *,
    params: Sequence[str] = (),
    data: Path | None = None,
    sensor: str | None = None,
    quick: bool = False,
) -> tuple[Model, str]:
    """Return a model with weights from the cache, and its label.

    Args:
        name: Name of the model, or a file of ``tactibench weights export``, for which the other
            arguments are not used.
        protocol: Name or file of the protocol that it was trained on.
        params: Parameters as texts, such as "model.width=32".
        data: Folder of recorded frames that it was trained on.
        sensor: Sensor that it was trained on.
        quick: Whether to take the weights of a quick run.

    Raises:
        UserError: There are no weights (the sentence tells how to train them), or something in the
            request does not exist or does not fit.
    """
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.run import (
        SUFFIX,
        NullReporter,
        RunRequest,
        make_plan,
        no_weights,
        read_parameters,
    )
    from tactibench.run import train_model as load

    if name.endswith(SUFFIX):
        return open_weights(Path(name))
    request = RunRequest(
        protocol,
        name,
        parameters=read_parameters(tuple(params)),
        data=data,
        sensor=sensor,
        quick=quick,
    )
    plan = make_plan(request, PluginHost(), cache_folder())
    if not plan.weights.cached:
        raise no_weights(plan)
    return load(plan, NullReporter())[0], plan.components.model.label
