"""The hooks of the tiny plugin, for processes that see it installed."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    parameters = (Parameter("epochs", 3, "passes"), Parameter("width", 8, "has no effect"))
    yield ModelSpec("tiny", "tiny_tactile.parts:TinyModel", "reads all tips", parameters)
