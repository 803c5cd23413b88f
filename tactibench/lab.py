"""Services of the core for plugins that work with devices: presses to make, trained models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactibench.datasets.press_plan import (
    Press,
    PressPlan,
    plan_of_file,
    plan_of_protocol,
    press_rows,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import load_protocol
from tactibench.protocols.mistakes import first_mistake
from tactibench.records.files import write_json

if TYPE_CHECKING:
    from tactibench.plugins.base import Model
    from tactibench.protocols.draws import SensorShape

__all__ = [
    "Press",
    "PressPlan",
    "did_you_mean",
    "first_mistake",
    "plan_presses",
    "press_rows",
    "trained_model",
    "write_json",
]


def plan_presses(
    what: str, sensor: SensorShape, *, count: int | None = None, seed: int | None = None
) -> PressPlan:
    """Return all presses of a protocol or of a plan.jsonl.

    Args:
        what: Name or file of a protocol, or a file that ends in .jsonl.
        sensor: The sensor whose surface is pressed.
        count: Most presses of each set; None takes all.
        seed: Seed of other presses than the protocol's.

    Raises:
        UserError: There is no such protocol or file, or the sensor cannot be pressed so.
    """
    if what.endswith(".jsonl"):
        return plan_of_file(Path(what), seed or 0, count)
    protocol = load_protocol(what).spec
    if seed is not None:
        protocol = protocol.model_copy(update={"data_seed": seed})
    return plan_of_protocol(protocol, sensor, count)


def trained_model(
    name: str,
    protocol: str = "exp1",
    *,
    params: Sequence[str] = (),
    data: Path | None = None,
    regime: str | None = None,
    sensor: str | None = None,
    untrained: bool = False,
) -> tuple[Model, str]:
    """Return a model with weights from the cache, and the label it goes by.

    Args:
        name: Name of the model.
        protocol: Name or file of the protocol that it was trained on.
        params: Parameters as texts, such as "model.width=32".
        data: Folder of recorded frames that it was trained on.
        regime: Regime that it was trained in.
        sensor: Sensor that it was trained on.
        untrained: Whether to take random weights, to time a model.

    Raises:
        UserError: There are no weights; the sentence says how to train them.
    """
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.run.plan import make_plan
    from tactibench.run.reporter import NullReporter
    from tactibench.run.request import RunRequest, read_parameters
    from tactibench.run.train import train_model as load

    request = RunRequest(
        protocol,
        name,
        parameters=read_parameters(tuple(params)),
        data=data,
        regime=regime,
        sensor=sensor,
    )
    plan = make_plan(request, PluginHost(), cache_folder())
    label = plan.components.model.label
    if untrained:
        return plan.components.build_model(plan.context()), label
    if not plan.weights.cached:
        raise UserError(
            f"there are no trained weights of {label} in the cache for this request; make them "
            f"with `tactibench run {protocol} --model {name} --train-only` and the same options."
        )
    return load(plan, NullReporter())[0], label
