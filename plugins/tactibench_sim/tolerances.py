"""Ranges of what differs between sensors of one make, version 2: with a source, or "assumed".

A width is that of a uniform distribution around the nominal value: a tolerance says how far off a
part may be and not how often. Where one cause moves two numbers they move together:

* more gel between window and apex is a longer tip, so the apex lies as much farther from the
  camera; the seat of the camera varies beside that;
* the same LEDs light pins and gel, so both grow brighter together;
* a stiffer skin and a softer gel change one number, the ratio of their stiffnesses.

That skin and gain go together (a skin of 1.15 mm spreads a press wider and moves the pins 7 % more
on the mean, a stiffness ratio of 80 moves them 3 % more, 3 mm deep at the apex) comes from the
mechanics: ``instances.DomeDifferences`` has the fields of nine domes. docs/simulator.md lists the
sources.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from tactibench_sim.optics.camera import Optics

SHORE_A = 30.0
"""Hardness of a printed skin (assumed); a moulded one of 60 gives the same factors to 2 %."""


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


TOLERANCES = Tolerances()


def modulus(shore_a: float) -> float:
    """Return Young's modulus of a rubber in MPa from its hardness, Shore A.

    Gent, On the relation between indentation hardness and Young's modulus, Rubber Chemistry and
    Technology 31 (1958), 896: E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S)).
    """
    return 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def apply_optics(
    optics: Optics, pin_length_mm: float, shares: Mapping[str, float]
) -> tuple[Optics, float]:
    """Return optics and pin length, mm, of a sensor.

    Args:
        optics: Optics of the nominal sensor.
        pin_length_mm: Pin length of the nominal sensor.
        shares: Every field of ``Tolerances`` -> place of the sensor in its range, -1..1.
    """
    step = {f.name: shares[f.name] * getattr(TOLERANCES, f.name) for f in fields(Tolerances)}
    light, gel = 1 + step["light"], 1 + step["background"]
    seat = shares["seat_mm"] * TOLERANCES.seat_mm
    fill = shares["fill_mm"] * TOLERANCES.fill_mm
    gel_mm = max(optics.gel_mm + fill, 0.0)
    shown = replace(
        optics,
        camera_distance_mm=max(
            optics.camera_distance_mm + seat + fill, nearest_camera(optics, gel_mm)
        ),
        gel_mm=gel_mm,
        principal_x=optics.principal_x + step["principal_x"],
        principal_y=optics.principal_y + step["principal_y"],
        roll_deg=optics.roll_deg + step["roll_deg"],
        marker_radius_mm=max(
            optics.marker_radius_mm + step["marker_radius_mm"], 0.5 * optics.marker_radius_mm
        ),
        focal=optics.focal * (1 + step["focal"]),
        edge_px=max(optics.edge_px + step["edge_px"], 0.1 * optics.edge_px),
        vignetting=min(max(optics.vignetting + step["vignetting"], 0.0), 1.0),
        brightness=optics.brightness * light,
        background=optics.background * light * gel,
    )
    return shown, max(pin_length_mm + step["pin_length_mm"], 0.1 * pin_length_mm)


def nearest_camera(optics: Optics, gel_mm: float) -> float:
    """Return the least distance from the camera to the apex of an instance, mm.

    A tenth of the nominal sensor's air is left, which matters where the camera is right behind its
    window.

    Args:
        optics: Optics of the nominal sensor.
        gel_mm: Gel of the instance, from the apex to the window.
    """
    return gel_mm + optics.window_mm + 0.1 * optics.air_mm


def dome_factors(shares: Mapping[str, float], skin_mm: float = 1.0) -> tuple[float, float]:
    """Return the factors on the stiffness ratio of skin and gel and on the skin's thickness.

    Args:
        shares: As ``apply_optics`` takes them.
        skin_mm: Nominal thickness of the skin.
    """
    hardness = SHORE_A + shares["hardness"] * TOLERANCES.hardness
    skin = modulus(hardness) / modulus(SHORE_A)
    gel = math.exp(shares["gel"] * math.log(TOLERANCES.gel))
    return skin / gel, 1 + shares["skin_mm"] * TOLERANCES.skin_mm / skin_mm
