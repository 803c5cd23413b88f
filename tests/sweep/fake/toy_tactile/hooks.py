from __future__ import annotations

from tactibench import ModelSpec, Parameter, SensorSpec, hookimpl


@hookimpl
def tactibench_models() -> list[ModelSpec]:
    deaths = Parameter("deaths", 0, "how often it kills its process while it is trained", low=0)
    noise = Parameter("noise", 0.0, "has no effect")
    return [
        ModelSpec("toy", "toy_tactile.parts:Toy", "reads the tips", (deaths, noise)),
        ModelSpec("toy-broken", "toy_tactile.parts:Broken", "raises while it is trained"),
        ModelSpec("toy-slow", "toy_tactile.parts:Slow", "is trained for an hour"),
        ModelSpec("toy-single", "toy_tactile.parts:Toy", "one contact", max_contacts=1),
    ]


@hookimpl
def tactibench_sensors() -> list[SensorSpec]:
    return [SensorSpec("toy", "toy_tactile.parts:ToySensor", "twenty pixels")]
