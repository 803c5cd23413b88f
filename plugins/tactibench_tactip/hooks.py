"""The sensor and the command that this plugin declares."""

from __future__ import annotations

from tactibench import CommandSpec, Parameter, SensorSpec, hookimpl


@hookimpl
def tactibench_sensors() -> list[SensorSpec]:
    """Declare sensor ``tactip``."""
    return [
        SensorSpec(
            "tactip",
            "tactibench_tactip.sensor:TacTip",
            "a real TacTip and the robot that presses it, as a configuration file says",
            (Parameter("config", "", "the configuration file, see docs/hardware.md"),),
            origin="real",
        )
    ]


@hookimpl
def tactibench_commands() -> list[CommandSpec]:
    """Declare ``tactibench hw``."""
    return [
        CommandSpec(
            "hw",
            "tactibench_tactip.commands:hw",
            "work with a real TacTip: check it, calibrate, collect, watch, rehearse",
        )
    ]
