from __future__ import annotations

from tactibench import ModelSpec, SensorSpec, hookimpl


@hookimpl
def tactibench_models() -> list[ModelSpec]:
    return [
        ModelSpec("steady", "unsteady_tactile.parts:Steady", "the same every time"),
        ModelSpec("shaky", "unsteady_tactile.parts:Shaky", "learns from the system's dice"),
        ModelSpec("moody", "unsteady_tactile.parts:Moody", "answers by the order of a set"),
        ModelSpec("ill", "unsteady_tactile.parts:Ill", "raises while it is trained"),
    ]


@hookimpl
def tactibench_sensors() -> list[SensorSpec]:
    return [
        SensorSpec("still", "unsteady_tactile.parts:Still", "twenty pixels"),
        SensorSpec("threaded", "unsteady_tactile.parts:Threaded", "looks at its threads"),
    ]
