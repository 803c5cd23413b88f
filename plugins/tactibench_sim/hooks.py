"""The simulator's declarations: TacTips, finite-element scenes, a pad, fitted TacTips."""

from __future__ import annotations

from dataclasses import replace

from tactibench import Parameter, SensorSpec, hookimpl
from tactibench_sim.camera import FITTED, PLANAR_GRID, TACTIP_127, TACTIP_331, parameters_of

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
    Parameter("pin_length", 2.0, "length of the pins, mm", low=0.0, high=6.0),
    Parameter(
        "friction",
        0.0,
        "Coulomb's coefficient of tips that move sideways (dx, dy, dyaw of a pose); 0: no drag",
        low=0.0,
        high=2.0,
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
    *(
        p
        for p in parameters_of(FITTED)
        if p.name.startswith(("glare", "threshold")) or p.name in {"output", "leds"}
    ),
)


@hookimpl
def tactibench_sensors() -> tuple[SensorSpec, ...]:
    """Declare the simulated sensors, and one of finite-element scenes for each TacTip."""
    domes = [
        SensorSpec(
            name=f"tactip-{pins}",
            target=f"tactibench_sim.tactip:TacTip{pins}",
            summary=f"simulated TacTip, {pins} pins, finite-element fields, camera behind a window",
            parameters=(*DOME, *parameters_of(camera)),
        )
        for pins, camera in ((127, TACTIP_127), (331, TACTIP_331))
    ]
    scenes = [
        replace(
            dome,
            name=f"{dome.name}-fem",
            target=f"tactibench_sim.reference:Reference{dome.name.removeprefix('tactip-')}",
            summary=f"finite-element scenes of {dome.name}, for --test reference",
            # finite elements have said how the scenes become fields
            parameters=tuple(p for p in dome.parameters if p.name != "tier"),
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
            parameters=FITTED_PARAMETERS,
        )
        for pins in (127, 331)
    ]
    return (*domes, *scenes, planar, *fitted)
