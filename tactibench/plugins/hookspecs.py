"""The hooks a plugin may implement. All are optional; all return light, frozen specs."""

from __future__ import annotations

from collections.abc import Iterable

import pluggy

from tactibench.plugins.specs import CommandSpec, EncoderSpec, ModelSpec, SensorSpec

GROUP = "tactibench"
"""The entry-point group and the pluggy project name."""

hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


@hookspec
def tactibench_models() -> Iterable[ModelSpec]:  # type: ignore[empty-body]
    """Declare models. Called once, when a command first needs to know the models there are."""


@hookspec
def tactibench_sensors() -> Iterable[SensorSpec]:  # type: ignore[empty-body]
    """Declare sensors. Called once, when a command first needs to know the sensors there are."""


@hookspec
def tactibench_encoders() -> Iterable[EncoderSpec]:  # type: ignore[empty-body]
    """Declare encoders. Called once, when a command first needs to know the encoders there are."""


@hookspec
def tactibench_commands() -> Iterable[CommandSpec]:  # type: ignore[empty-body]
    """Declare command-line verbs. Called when the command line looks a verb up or lists verbs."""
