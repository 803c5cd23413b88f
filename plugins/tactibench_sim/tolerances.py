"""Draws of sensor instances: what differs between sensors of one make, and how far.

The random draw is of the instance, not of the press: instance N is the same in every run, whatever
seed the run's noise has. Instance 0 is the nominal sensor. 0 to 9 are there to be tested on; they
lie in assumed ranges, ``Spread``. A training on several instances takes 10 and on; they lie in
``Tolerances``, whose ranges have a source each, or are said to be assumed.

A width is that of a uniform distribution around the nominal value: a tolerance says how far off a
part may be and not how often. Where one cause moves two numbers they move together:

* more gel between window and apex is a longer tip, so the apex lies as much farther from the
  camera; the seat of the camera varies beside that;
* the same LEDs light pins and gel, so both grow brighter together;
* a stiffer skin and a softer gel change one number, the ratio of their stiffnesses.

That skin and gain go together (a skin of 1.15 mm spreads a press wider and moves the pins 7 % more
on the mean, a stiffness ratio of 80 moves them 3 % more, 3 mm deep at the apex) comes from the
mechanics: ``instances`` has the fields of nine domes. docs/simulator-method.md lists the sources.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from tactibench_sim.camera import Optics

RESERVED = 10
"""Number of instances, 0 to 9, that are for tests and never for training."""
RATIO_FACTOR = 2.0
"""Stiffness ratio of skin and gel, tests: log-uniform between half and twice the nominal 50
(another batch of silicone; ratios 10 to 300 describe real plate presses equally well)."""
SKIN_FACTOR = 1.25
"""Skin thickness, tests: log-uniform between 0.8 and 1.25 times the nominal 1 mm (printing)."""
SHORE_A = 30.0
"""Hardness of a printed skin (assumed); a moulded one of 60 gives the same factors to 2 %."""
_RELATIVE = ("focal", "marker_radius_mm", "brightness", "background")


@dataclass(frozen=True)
class Spread:
    """Half-widths of the uniform ranges around the nominal values (all assumed).

    Attributes:
        camera_distance_mm: Seat of the camera.
        principal_x: Axis of the camera in the frame, sides.
        principal_y: Likewise.
        roll_deg: Turn of the camera; the real rest frames are turned by up to 2 deg.
        gel_mm: Fill level.
        pin_length_mm: Moulding of the pins.
        edge_px: Focus.
        vignetting: Fall-off of the light, absolute.
        focal: Lens, relative to the nominal value.
        marker_radius_mm: Paint of the tips, relative.
        brightness: LEDs on the pins, relative.
        background: LEDs on the gel, relative.
    """

    camera_distance_mm: float = 0.5
    principal_x: float = 0.01
    principal_y: float = 0.01
    roll_deg: float = 2.0
    gel_mm: float = 0.5
    pin_length_mm: float = 0.1
    edge_px: float = 0.2
    vignetting: float = 0.2
    focal: float = 0.02
    marker_radius_mm: float = 0.05
    brightness: float = 0.1
    background: float = 0.2


@dataclass(frozen=True)
class Tolerances:
    """Half-widths of the uniform ranges.

    Attributes:
        seat_mm: Place of the camera along its axis (assumed: printed mounts and a turned thread).
        fill_mm: Level of the gel (assumed: the tip is filled by syringe until it is full).
        principal_x: Axis of the camera beside the frame's middle, sides.
        principal_y: Likewise. The pins of the two real rest frames lie 0.004 to 0.014 sides off it
            in x and in y; a maker of board cameras allows far more (5 deg, 0.08 sides).
        roll_deg: Turn of the camera; 3 deg by the same maker, 2 deg in the real rest frames.
        pin_length_mm: 0.1 mm, the middle of what is stated for such printers, at either end.
        marker_radius_mm: 0.1 mm on the diameter.
        focal: Share; the usual tolerance of a small lens.
        edge_px: Focus, set by hand (assumed).
        vignetting: Share of the natural fall-off (assumed).
        light: Share, of pins and gel alike: a bin of LEDs spans a factor of 1.26.
        background: Share, of the gel beside that (assumed: clearness of gel and paint).
        skin_mm: Thickness of the skin; the far end of what is stated for such printers.
        hardness: Shore A of the skin, by which its modulus follows (``modulus``).
        gel: Factor of the gel's modulus either way (assumed; with the skin's it just stays within
            the tables).
    """

    seat_mm: float = 0.5
    fill_mm: float = 0.5
    principal_x: float = 0.02
    principal_y: float = 0.02
    roll_deg: float = 3.0
    pin_length_mm: float = 0.2
    marker_radius_mm: float = 0.05
    focal: float = 0.05
    edge_px: float = 0.2
    vignetting: float = 0.2
    light: float = 0.12
    background: float = 0.2
    skin_mm: float = 0.15
    hardness: float = 5.0
    gel: float = 1.6


def modulus(shore_a: float) -> float:
    """Return Young's modulus of a rubber in MPa from its hardness, Shore A.

    Gent, On the relation between indentation hardness and Young's modulus, Rubber Chemistry and
    Technology 31 (1958), 896: E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S)).
    """
    return 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def stream(instance: int, purpose: str) -> np.random.Generator:
    """Return the random generator of an instance for one purpose; a new purpose changes no other.

    Args:
        instance: Number of the instance.
        purpose: Any text.
    """
    return np.random.default_rng([instance, *purpose.encode()])


def perturb(
    optics: Optics, pin_length_mm: float, instance: int, spread: Spread | None = None
) -> tuple[Optics, float]:
    """Return optics and pin length of instance N of a nominal sensor.

    Shares stay within 0..1, lengths above a tenth of the nominal ones.

    Args:
        optics: Optics of the nominal sensor.
        pin_length_mm: Pin length of the nominal sensor.
        instance: Number N; 0 is the nominal sensor.
        spread: Ranges of all instances; None: those of the number.

    Returns:
        The optics, and the pin length, mm.
    """
    if instance == 0:
        return optics, pin_length_mm
    if instance >= RESERVED and spread is None:
        step = _steps(instance)
        light, gel = 1 + step["light"], 1 + step["background"]
        values = {
            name: getattr(optics, name) + step[name]
            for name in ("principal_x", "principal_y", "roll_deg", "edge_px", "vignetting")
        }
        values |= {
            "gel_mm": max(optics.gel_mm + step["fill_mm"], 0.0),
            "camera_distance_mm": optics.camera_distance_mm + step["seat_mm"] + step["fill_mm"],
            "marker_radius_mm": max(
                optics.marker_radius_mm + step["marker_radius_mm"], 0.5 * optics.marker_radius_mm
            ),
            "focal": optics.focal * (1 + step["focal"]),
            "brightness": optics.brightness * light,
            "background": optics.background * light * gel,
        }
    else:
        spread = spread or Spread()
        draws = stream(instance, "optics").uniform(-1.0, 1.0, len(fields(spread)))
        step = {
            field.name: float(share) * getattr(spread, field.name)
            for field, share in zip(fields(spread), draws, strict=True)
        }
        values = {}
        for name in step.keys() - {"pin_length_mm"}:
            nominal = getattr(optics, name)
            relative = name in _RELATIVE
            values[name] = nominal * (1 + step[name]) if relative else nominal + step[name]
    values["vignetting"] = min(max(values["vignetting"], 0.0), 1.0)
    values["edge_px"] = max(values["edge_px"], 0.1 * optics.edge_px)
    # A tenth of the nominal air is left, where the camera is right behind its window.
    nearest = values["gel_mm"] + optics.window_mm + 0.1 * optics.air_mm
    values["camera_distance_mm"] = max(values["camera_distance_mm"], nearest)
    length = max(pin_length_mm + step["pin_length_mm"], 0.1 * pin_length_mm)
    return replace(optics, **values), length


def dome_of(instance: int) -> tuple[float, float]:
    """Return logarithms (x, y) of the dome of instance N, each in -1..1; (0, 0): nominal.

    Its stiffness ratio is RATIO_FACTOR**x times the nominal one, its skin SKIN_FACTOR**y times.
    """
    if instance == 0:
        return 0.0, 0.0
    if instance >= RESERVED:
        step = _steps(instance)
        skin = modulus(SHORE_A + step["hardness"]) / modulus(SHORE_A)
        gel = math.exp(_share(instance, "gel") * math.log(Tolerances().gel))
        return math.log(skin / gel, RATIO_FACTOR), math.log(1 + step["skin_mm"], SKIN_FACTOR)
    x, y = stream(instance, "dome").uniform(-1.0, 1.0, 2)
    return float(x), float(y)


def _steps(instance: int) -> dict[str, float]:
    """Return how far instance N is off the nominal sensor, by field of ``Tolerances``."""
    widths = Tolerances()
    return {f.name: _share(instance, f.name) * getattr(widths, f.name) for f in fields(widths)}


def _share(instance: int, name: str) -> float:
    """Return the place of instance N in one of the ranges of ``Tolerances``, -1..1.

    Every range has random numbers of its own, so that a new one would not change the others.
    """
    return float(stream(instance, f"tolerance {name}").uniform(-1.0, 1.0))


def lost_pins(pins: int, share: float, instance: int) -> npt.NDArray[np.bool_]:
    """Return (pins,) True for the pins of an instance that have no white tip.

    These are round(share * pins) pins. A greater share loses the same pins and more.

    Args:
        pins: Number of pins.
        share: Share of the pins that are lost, 0..1.
        instance: Number of the instance.
    """
    lost = np.zeros(pins, dtype=np.bool_)
    lost[stream(instance, "pin loss").permutation(pins)[: round(share * pins)]] = True
    return lost
