"""What the simulated TacTip offers: two sensors and the command `sim`."""

from __future__ import annotations

from tactibench import CommandSpec, Parameter, SensorSpec, hookimpl

PARAMETERS = (
    Parameter("tier", "coupled", "how contacts share the load", choices=("coupled", "superpose")),
    Parameter("size", 128, "frame side, px", low=32, high=1024),
    Parameter("noise", True, "camera noise on or off"),
    Parameter("read_noise", 1.5, "read noise, grey levels rms", low=0.0, high=50.0),
    Parameter("full_well", 10000.0, "electrons at grey level 255 (shot noise)", low=100.0),
    Parameter("brightness", 208.0, "grey level of the pin tips", low=1.0, high=255.0),
    Parameter("background", 16.0, "grey level of the gel", low=0.0, high=254.0),
    Parameter("edge", 1.0, "half-width of a pin's soft edge, px", low=0.5, high=10.0),
    Parameter("pin_length", 2.0, "length of the pins, mm", low=0.0, high=6.0),
    Parameter("pin_radius", 0.5, "radius of the pins' white tips, mm", low=0.1, high=1.5),
    Parameter("camera_distance", 55.0, "from camera to apex, mm", low=45.0, high=200.0),
    Parameter("table", "", "file made by `sim tabulate`; empty: the table that ships"),
    Parameter("focal", 1.0294, "focal length, frame sides", low=0.2, high=5.0),
)


@hookimpl
def tactibench_sensors() -> tuple[SensorSpec, ...]:
    return tuple(
        SensorSpec(
            name=f"tactip-{pins}",
            target=f"tactibench_sim.sensor:TacTip{pins}",
            summary=f"simulated TacTip, {pins} pins, finite-element fields, pinhole camera",
            parameters=PARAMETERS,
            origin="simulated",
        )
        for pins in (127, 331)
    )


@hookimpl
def tactibench_commands() -> tuple[CommandSpec, ...]:
    return (
        CommandSpec(
            name="sim",
            target="tactibench_sim.command:sim",
            summary="work on the simulated TacTip: tabulate its finite-element fields",
        ),
    )
