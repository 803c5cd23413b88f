"""The simulator's declarations: TacTips, finite-element scenes, a pad, fitted TacTips."""

from __future__ import annotations

from dataclasses import replace

from tactibench import Parameter, SensorSpec, hookimpl
from tactibench_sim.camera import PLANAR_GRID, TACTIPS, parameters_of

TIER = Parameter("tier", "coupled", "how contacts share the load", choices=("coupled", "superpose"))
TABLE = Parameter(
    "table",
    "",
    "file of scripts/fem/tabulate_presses.py; empty: the table that ships",
)
INSTANCE = Parameter(
    "instance",
    0,
    "0: nominal; N: another sensor instance (stiffness ratio, skin, pins, camera)",
    low=0,
    high=10**9,
)
DOME = (
    TIER,
    TABLE,
    INSTANCE,
    Parameter(
        "instances",
        0,
        "train on so many sensor instances (10 and on), 0 or 1: on one; tests stay nominal",
        low=0,
        high=1000,
    ),
    Parameter(
        "friction",
        0.5,
        "Coulomb's coefficient of tips and skin, nominal; 0: without friction",
        low=0.0,
        high=2.0,
    ),
    Parameter(
        "friction_between",
        1.5,
        "factor by which the friction of instances differs, either way; 1: all alike",
        low=1.0,
        high=4.0,
    ),
    Parameter(
        "friction_within",
        0.13,
        "friction from press to press, standard deviation as a share; 0: always the same",
        low=0.0,
        high=1.0,
    ),
    Parameter(
        "modulus",
        0.0,
        "Young's modulus of the skin, MPa, with which presses tell forces; 0: they tell none",
        low=0.0,
        high=1000.0,
    ),
)
PLANAR = (
    TIER,
    TABLE,
    replace(INSTANCE, help="0: nominal; N: another sensor instance (pins, camera)"),
)
FITTED_PARAMETERS = (
    Parameter("size", 256, "frame side, px", low=32, high=1024),
    Parameter("drag", 5.0, "a plate's sideways travel, at most, mm", low=0.0, high=20.0),
    Parameter("dragged", 0.6, "share of a plate's presses that drag the skin", low=0.0, high=1.0),
    Parameter(
        "spread",
        0.0,
        "0: the calibrated sensor; 1: instances with other pins and cameras, in assumed ranges",
        low=0.0,
        high=3.0,
    ),
    Parameter(
        "individuals", 16, "how many sensor instances, where spread is not 0", low=1, high=1000
    ),
    Parameter(
        "calibration",
        "",
        "file of benchmarks/sim_against_real.py; empty: the fit to the public recording",
    ),
)


@hookimpl
def tactibench_sensors() -> tuple[SensorSpec, ...]:
    """Declare the simulated sensors, and one of finite-element scenes for each TacTip."""
    domes = [
        SensorSpec(
            name=f"tactip-{pins}",
            target=f"tactibench_sim.tactip:TacTip{pins}",
            summary=f"simulated TacTip, {pins} pins; finite-element fields, friction; camera and "
            "pins fitted to real presses",
            parameters=(
                *DOME,
                Parameter(
                    "pin_length", preset.pin_length_mm, "lever of the pins, mm", low=0.0, high=6.0
                ),
                *parameters_of(preset.optics),
            ),
        )
        for pins, preset in TACTIPS.items()
    ]
    scenes = [
        replace(
            dome,
            name=f"{dome.name}-fem",
            target=f"tactibench_sim.reference:Reference{dome.name.removeprefix('tactip-')}",
            summary=f"finite-element scenes of {dome.name}, for --test reference",
            # finite elements have said how the scenes become fields
            parameters=tuple(
                p
                for p in dome.parameters
                if p.name not in {"tier", "friction_between", "friction_within", "modulus"}
            ),
            reference_of=dome.name,
            scenes="finite-element scenes",
        )
        for dome in domes
    ]
    planar = SensorSpec(
        name="planar-grid",
        target="tactibench_sim.planar:PlanarGrid",
        summary="simulated flat gel pad, 14 x 14 markers, finite-element fields, camera below",
        # The pad's thickness, which gel_length is elsewhere, belongs to its table.
        parameters=(*PLANAR, *(p for p in parameters_of(PLANAR_GRID) if p.name != "gel_length")),
    )
    fitted = [
        SensorSpec(
            name=f"fitted-{pins}",
            target=f"tactibench_sim.fitted:Fitted{pins}",
            summary=f"simulated TacTip, {pins} pins; camera, pins and a plate's drag fitted to "
            "real presses",
            parameters=(
                *FITTED_PARAMETERS,
                *(
                    p
                    for p in parameters_of(preset.optics)
                    if p.name.startswith(("glare", "threshold")) or p.name in {"output", "leds"}
                ),
            ),
        )
        for pins, preset in TACTIPS.items()
    ]
    return (*domes, *scenes, planar, *fitted)
