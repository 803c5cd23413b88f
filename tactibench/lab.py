"""What a plugin that works with devices asks of the core: presses of a protocol, trained models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactibench.datasets.generating.stretches import Press, Pressing, Stretch
from tactibench.errors import did_you_mean
from tactibench.records.files import write_json

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

    from tactibench.plugins.base import Model
    from tactibench.protocols.draws import SensorShape

__all__ = [
    "Press",
    "Pressing",
    "Stretch",
    "did_you_mean",
    "first_mistake",
    "presses_of",
    "trained_model",
    "write_json",
]


def first_mistake(error: ValidationError, schema: type[BaseModel]) -> str:
    """The first mistake in a validated file: its key, what was found and what is allowed."""
    from tactibench.protocols.mistakes import first_mistake as found

    return found(error, schema)


def presses_of(
    what: str, sensor: SensorShape, *, count: int | None = None, seed: int | None = None
) -> Pressing:
    """All presses of a protocol, by name or file, or of a plan.jsonl.

    sensor: on whose surface. count: at most, of every set. seed: other presses than the
    protocol's. Raises UserError.
    """
    from tactibench.datasets.generating.protocol import from_protocol
    from tactibench.datasets.generating.stretches import from_file
    from tactibench.protocols.loader import load_protocol

    if what.endswith(".jsonl"):
        return from_file(Path(what), seed or 0, count)
    keys = load_protocol(what).keys
    if seed is not None:
        keys = keys.model_copy(update={"data_seed": seed})
    return from_protocol(keys, sensor, count)


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
    """A model with weights from the cache, and the label it goes by.

    untrained: with random weights, whose answers say nothing, to time it. Raises UserError, which
    says how to train it, where there are no weights.
    """
    from tactibench.cli.output import Terminal
    from tactibench.errors import UserError
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.run.plan import make_plan
    from tactibench.run.request import RunRequest, read_parameters
    from tactibench.run.train import trained_model as load

    request = RunRequest(
        protocol,
        name,
        parameters=read_parameters(tuple(params)),
        data=data,
        regime=regime,
        sensor=sensor,
    )
    plan = make_plan(request, PluginHost(), cache_folder())
    label = plan.parts.model.label()
    if untrained:
        return plan.parts.build_model(plan.context()), label
    if not plan.weights.cached:
        raise UserError(
            f"there are no trained weights of {label} in the cache for this request; make them "
            f"with `tactibench run {protocol} --model {name} --train-only` and the same options."
        )
    return load(plan, Terminal())[0], label
