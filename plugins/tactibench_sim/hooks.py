"""The simulator's declarations: two TacTips, a planar sensor, fitted sensors, command `sim`."""

from __future__ import annotations

from dataclasses import replace

from tactibench import CommandSpec, Parameter, SensorSpec, hookimpl

OPTICAL = (
    Parameter("size", 128, "frame side, px", low=32, high=1024),
    Parameter(
        "output",
        "grey",
        "frame format; bw: thresholded as real sets are",
        choices=("grey", "rgb", "bw"),
    ),
    Parameter("noise", True, "camera noise on or off"),
    Parameter("read_noise", 1.5, "read noise, grey levels rms", low=0.0, high=50.0),
    Parameter("full_well", 1e4, "electrons at grey level 255 (shot noise)", low=100.0, high=1e12),
    Parameter("brightness", 208.0, "grey level of the pin tips", low=1.0, high=255.0),
    Parameter("background", 16.0, "grey level of the gel", low=0.0, high=254.0),
    Parameter("edge", 1.0, "half-width of a pin's soft edge, px", low=0.5, high=10.0),
    Parameter("blur", 0.0, "sigma of a further Gaussian blur, px", low=0.0, high=20.0),
    Parameter("vignetting", 0.3, "share of the natural fall-off cos^4", low=0.0, high=1.0),
    Parameter("pin_radius", 0.4, "radius of the pins' white tips, mm", low=0.1, high=1.5),
    Parameter("pin_loss", 0.0, "share of pins without a white tip", low=0.0, high=0.9),
    Parameter("camera_distance", 55.0, "from camera to apex, mm", low=10.0, high=200.0),
    Parameter(
        "lens",
        "pinhole",
        "projection: r = f tan a or (fisheye) r = f a",
        choices=("pinhole", "fisheye"),
    ),
    Parameter("focal", 0.956, "focal length, frame sides", low=0.2, high=5.0),
    Parameter("principal_x", 0.0, "axis right of the frame's middle, sides", low=-0.3, high=0.3),
    Parameter("principal_y", 0.0, "axis below the frame's middle, sides", low=-0.3, high=0.3),
    Parameter(
        "roll", 0.0, "turn of the camera about its axis, x towards y, deg", low=-180.0, high=180.0
    ),
    Parameter("gel_length", 20.0, "from the apex to the window, mm", low=1.0, high=100.0),
    Parameter(
        "gel_index", 1.41, "refractive index of the gel; 1: no refraction", low=1.0, high=2.0
    ),
    Parameter("window_thickness", 2.0, "thickness of the acrylic window, mm", low=0.0, high=20.0),
    Parameter("window_index", 1.49, "refractive index of the window", low=1.0, high=2.0),
    Parameter(
        "glare", 0.0, "light of the LEDs' reflections, 0: none, 1: as the tips", low=0.0, high=1.0
    ),
    Parameter("leds", 6, "how many LEDs reflect", low=0, high=64),
    Parameter("glare_start", -5.0, "azimuth of the first LED, deg", low=-180.0, high=180.0),
    Parameter("glare_radius", 0.47, "radius of the reflections' circle, sides", low=0.05, high=1.0),
    Parameter("glare_width", 0.017, "greatest thickness of a reflection, sides", low=0.0, high=0.2),
    Parameter("glare_arc", 27.0, "length of a reflection, deg", low=1.0, high=360.0),
    Parameter(
        "glare_scatter",
        0.0,
        "irregularity of the reflections, 0: none",
        low=0.0,
        high=1.0,
    ),
    Parameter("glare_seed", 0, "which irregular reflections", low=0, high=10**9),
    Parameter("red", 0.92, "red share of white light (output rgb)", low=0.05, high=1.0),
    Parameter("green", 0.98, "green share of white light (output rgb)", low=0.05, high=1.0),
    Parameter("blue", 1.0, "blue share of white light (output rgb)", low=0.05, high=1.0),
    Parameter("threshold_side", 61 / 360, "block of the threshold (bw), sides", low=0.02, high=1.0),
    Parameter("threshold", 5.0, "grey levels above the block (output bw)", low=0.0, high=100.0),
)
"""Parameters of every camera; ``optics.camera.Optics`` says where their defaults come from."""


def optical(**defaults: float) -> tuple[Parameter, ...]:
    """Return OPTICAL with other defaults for the named parameters."""
    return tuple(replace(p, default=defaults.get(p.name, p.default)) for p in OPTICAL)


VERSION = Parameter(
    "version",
    1,
    "2: lever, camera and pins as fitted to the real sensor; 1: as stored runs have them",
    choices=(1, 2),
)
FITTED_OUTPUT: dict[str, str | float] = {"threshold": 50.0}
FITTED_CAMERA = {**FITTED_OUTPUT, "lens": "fisheye", "window_thickness": 0.0}
VERSIONS: dict[int, dict[str, str | float]] = {
    127: {
        **FITTED_CAMERA,
        "pin_length": 0.605,
        "camera_distance": 23.352,
        "focal": 0.2897,
        "gel_length": 22.852,
        "pin_radius": 0.4096,
    },
    331: {
        **FITTED_CAMERA,
        "pin_length": 0.403,
        "camera_distance": 23.486,
        "focal": 0.3388,
        "gel_length": 21.486,
        "pin_radius": 0.4057,
    },
}
"""Number of pins -> defaults of version 2 that differ from those of version 1."""
DOME = (
    VERSION,
    Parameter(
        "tier",
        "coupled",
        "how scenes become displacement fields; `sim validate` compares them",
        choices=("coupled", "fem", "superpose"),
    ),
    Parameter(
        "table",
        "",
        "file of scripts/fem/tabulate_dome.py; empty: the table that ships",
        built_in=("",),
    ),
    Parameter(
        "instance",
        0,
        "0: nominal; N: another sensor instance (stiffness ratio, skin, pins, camera)",
        low=0,
        high=10**9,
    ),
    Parameter(
        "instances",
        0,
        "train on so many sensor instances (10 and on), 0 or 1: on one; tests stay nominal",
        low=0,
        high=1000,
    ),
    Parameter(
        "ranges",
        1,
        "ranges that instance is drawn from, 1: assumed, 2: tolerances, as for instances",
        choices=(1, 2),
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
    Parameter("tier", "coupled", "how contacts share the load", choices=("coupled", "superpose")),
    Parameter(
        "table",
        "",
        "file of scripts/fem/tabulate_pad.py; empty: the table that ships",
        built_in=("",),
    ),
    Parameter("instance", 0, "0: nominal; N: another sensor instance", low=0, high=10**9),
)

FITTED = (
    Parameter(
        "version",
        1,
        "2: pins as large as in real frames, larger when pressed; 1: as stored runs have them",
        choices=(1, 2),
    ),
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
        "331 or 127: the fit to that public recording, with slip; or a file of `sim real --keep`; "
        "empty: version 1, a fit to 200 presses of the 331-pin recording without slip",
        built_in=("", "127", "331"),
    ),
    *(
        p
        for p in OPTICAL
        if p.name.startswith(("glare", "threshold")) or p.name in {"output", "leds"}
    ),
)


@hookimpl
def tactibench_sensors() -> tuple[SensorSpec, ...]:
    """Declare the simulated sensors."""
    optics = {
        127: optical(pin_radius=0.36),
        331: optical(pin_radius=0.47, glare_width=0.014, glare_arc=80.0),
    }
    domes = (
        SensorSpec(
            name=f"tactip-{pins}",
            target=f"tactibench_sim.sensor:TacTip{pins}",
            summary=f"simulated TacTip, {pins} pins, finite-element fields, camera behind a window",
            parameters=(*DOME, *camera),
            origin="simulated",
            versions={2: VERSIONS[pins]},
        )
        for pins, camera in optics.items()
    )
    flat = optical(pin_radius=0.3, camera_distance=30.0, focal=1.15)
    planar = SensorSpec(
        name="planar-grid",
        target="tactibench_sim.planar.sensor:PlanarGrid",
        summary="simulated flat gel pad, 14 x 14 markers, finite-element fields, camera below",
        # The pad's thickness, which gel_length is elsewhere, belongs to its table.
        parameters=(*PLANAR, *(p for p in flat if p.name != "gel_length")),
        origin="simulated",
    )
    pressed = (
        SensorSpec(
            name=f"fitted-{pins}",
            target=f"tactibench_sim.real.sensor:Fitted{pins}",
            summary=f"simulated TacTip, {pins} pins; camera, pins and a plate's drag fitted to "
            "real presses",
            parameters=FITTED,
            origin="simulated",
            versions={2: FITTED_OUTPUT},
        )
        for pins in optics
    )
    return (*domes, planar, *pressed)


@hookimpl
def tactibench_commands() -> tuple[CommandSpec, ...]:
    """Declare the command `sim`."""
    return (
        CommandSpec(
            name="sim",
            target="tactibench_sim.commands.sim:sim",
            summary="work on the simulated sensors: draw a press, compare with finite elements "
            "and with real presses",
        ),
    )
