"""Other sensors of the same kind: a nominal sensor with small errors of manufacture.

What is drawn is the individual, not the press: instance N is the same in every run, whatever seed
the run's noise has. Instance 0 is the nominal sensor. The ranges are assumed: wide enough for a
model to feel them, narrow enough for sensors of one make.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from tactibench_sim.optics import Optics


@dataclass(frozen=True)
class Spread:
    """Half-widths of the uniform ranges around the nominal values (all assumed).

    Absolute: camera_distance_mm (seat of the camera), principal_x and principal_y (sides), roll_deg
    (the real rest frames are turned by up to 2 deg), gel_mm (fill level), pin_length_mm (moulding),
    edge_px (focus), vignetting. Relative: focal (lens), marker_radius_mm (paint), brightness and
    background (LEDs).
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


SPREAD = Spread()
RATIO_FACTOR = 2.0
"""Stiffness ratio of skin and gel: log-uniform between half and twice the nominal 50 (another
batch of silicone; ratios 10 to 300 describe real plate presses equally well)."""
SKIN_FACTOR = 1.25
"""Skin thickness: log-uniform between 0.8 and 1.25 times the nominal 1 mm (printing)."""
_RELATIVE = ("focal", "marker_radius_mm", "brightness", "background")


def stream(instance: int, purpose: str) -> np.random.Generator:
    """Random numbers of an individual for one purpose; new purposes do not disturb old ones."""
    return np.random.default_rng([instance, *purpose.encode()])


def perturbed(
    optics: Optics, pin_length_mm: float, instance: int, spread: Spread = SPREAD
) -> tuple[Optics, float]:
    """Optics and pin length of instance N of a nominal sensor; a pure function.

    Shares stay within 0..1, lengths above a tenth of the nominal ones.
    """
    if instance == 0:
        return optics, pin_length_mm
    drawn = stream(instance, "optics").uniform(-1.0, 1.0, len(fields(spread)))
    step = {
        f.name: float(u) * getattr(spread, f.name)
        for f, u in zip(fields(spread), drawn, strict=True)
    }
    length = max(pin_length_mm + step.pop("pin_length_mm"), 0.1 * pin_length_mm)
    new = {}
    for name, by in step.items():
        nominal = getattr(optics, name)
        new[name] = nominal * (1 + by) if name in _RELATIVE else nominal + by
    new["vignetting"] = min(max(new["vignetting"], 0.0), 1.0)
    new["edge_px"] = max(new["edge_px"], 0.1 * optics.edge_px)
    return replace(optics, **new), length


def made_dome(instance: int) -> tuple[float, float]:
    """Logarithms (x, y) of the dome of instance N, each in -1..1; (0, 0): the nominal dome.

    Its stiffness ratio is RATIO_FACTOR**x times the nominal one, its skin SKIN_FACTOR**y times.
    """
    if instance == 0:
        return 0.0, 0.0
    x, y = stream(instance, "dome").uniform(-1.0, 1.0, 2)
    return float(x), float(y)


def lost_pins(pins: int, share: float, instance: int) -> npt.NDArray[np.bool_]:
    """(pins,) True for pins without a white tip: round(share * pins) of them, by the individual.

    A greater share loses the same pins and more.
    """
    lost = np.zeros(pins, dtype=np.bool_)
    lost[stream(instance, "pin loss").permutation(pins)[: round(share * pins)]] = True
    return lost
