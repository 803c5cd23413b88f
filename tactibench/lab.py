"""Services of the core for plugins that work with devices: planned presses and trained models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactibench.datasets import Press, PressPlan, plan_of_file, plan_of_protocol, press_rows
from tactibench.errors import did_you_mean
from tactibench.protocols import load_protocol, parse_toml
from tactibench.records import atomic
from tactibench.run import open_weights

if TYPE_CHECKING:
    from tactibench.plugins import Model
    from tactibench.protocols import SensorShape

__all__ = [
    "Press",
    "PressPlan",
    "atomic",
    "did_you_mean",
    "open_weights",
    "parse_toml",
    "plan_presses",
    "press_rows",
    "trained_model",
]


def plan_presses(what: str, sensor: SensorShape, *, seed: int | None = None) -> PressPlan:
    """Return all presses of a protocol or of a plan.jsonl.

    Args:
        what: Name or file of a protocol, or a file that ends in .jsonl.
        sensor: The sensor whose surface is pressed.
        seed: Seed with which other presses than the protocol's are drawn; None for the protocol's.

    Raises:
        UserError: There is no such protocol or file, or the sensor cannot be pressed in this way.
    """
    if what.endswith(".jsonl"):
        return plan_of_file(Path(what), seed or 0)
    protocol = load_protocol(what).spec
    if seed is not None:
        protocol = protocol.model_copy(update={"data_seed": seed})
    return plan_of_protocol(protocol, sensor)


def trained_model(
    name: str,
    protocol: str = "exp1",
    *,
    params: Sequence[str] = (),
    data: Path | None = None,
    sensor: str | None = None,
) -> tuple[Model, str]:
    """Return a model with weights from the cache, and its label.

    Args:
        name: Name of the model, or a file of ``tactibench weights export``, for which the other
            arguments are not used.
        protocol: Name or file of the protocol that it was trained on.
        params: Parameters as texts, such as "model.width=32".
        data: Folder of recorded frames that it was trained on.
        sensor: Sensor that it was trained on.

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
    )
    plan = make_plan(request, PluginHost(), cache_folder())
    if not plan.weights.cached:
        raise no_weights(plan)
    return load(plan, NullReporter())[0], plan.components.model.label
