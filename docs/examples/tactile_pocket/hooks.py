"""What this plugin declares. Light: nothing heavy is imported before it is used."""

from collections.abc import Iterable

from tactibench import CommandSpec, EncoderSpec, ModelSpec, Parameter, SensorSpec, hookimpl


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    depth = Parameter("depth", 3.0, "depth that is answered, mm", low=0.5, high=6.0)
    yield ModelSpec(
        "apex",
        "tactile_pocket.apex:Apex",
        "answers one contact at the apex, whatever the frame",
        (depth,),
        max_contacts=1,
    )


@hookimpl
def tactibench_sensors() -> Iterable[SensorSpec]:
    yield SensorSpec("lamp", "tactile_pocket.lamp:Lamp", "a bright disc where the tip presses")


@hookimpl
def tactibench_encoders() -> Iterable[EncoderSpec]:
    yield EncoderSpec("cell", "tactile_pocket.cell:Cell", "the nearest cell holds the depth")


@hookimpl
def tactibench_commands() -> Iterable[CommandSpec]:
    yield CommandSpec("greet", "tactile_pocket.greet:greet", "say hello to a sensor")
