"""The fit of the unknowns to some presses: the same numbers for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from tactibench_sim.real.calibration import Unknowns
from tactibench_sim.real.plate import Rig, displacements, plate
from tactibench_sim.real.recording import Presses

Array = npt.NDArray[np.float64]

ALL = tuple(field.name for field in fields(Unknowns))
STEP = {
    "depth_offset_mm": 0.5,
    "pivot_mm": 5.0,
    "pivot_side_mm": 1.0,
    "tilt_offset_deg": 2.0,
    "yaw_deg": 1.0,
    "pin_length_mm": 0.3,
    "air_mm": 1.0,
    "gel_mm": 2.0,
    "focal_px": 10.0,
    "centre_x": 2.0,
    "centre_y": 2.0,
    "drag_per_mm": 0.2,
    "drag_per_deg": 0.01,
    "drag_offset_mm": 0.1,
    "drag_per_depth": 0.02,
    "drag_per_tilt": 0.1,
    "slip_mm": 0.1,
    "slip_power": 0.2,
    "give_per_mm": 0.01,
    "rest_x": 0.3,
    "rest_y": 0.3,
}
"""Step of each unknown; these steps change the presses by a similar amount."""
BOUNDS = {
    "air_mm": (0.05, 100.0),
    "gel_mm": (10.0, 60.0),
    "focal_px": (20.0, 2000.0),
    "slip_mm": (0.0, 10.0),
    "slip_power": (0.0, 3.0),
    "give_per_mm": (0.0, 0.07),  # at 0.07 the dome would yield more than half at 7 mm of travel
}
"""Limits of the unknowns that are positive by nature; all others are free."""
EVERY = 3
"""One pin in this many is fitted; all are reported."""
_SOFT = 1e-3
"""Rounds the norm at 0, where it has no slope."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a fit.

    Attributes:
        unknowns: The fitted unknowns.
        kind: Name of the dome (``plate.kinds``).
        loss: Mean relative error that was reached.
    """

    unknowns: Unknowns
    kind: str
    loss: float


def rig_of(presses: Presses, kind: str, lens: str = "fisheye", gel_index: float = 1.41) -> Rig:
    """Return all that the simulation of presses needs besides the unknowns.

    Args:
        presses: The presses, whose rest frame and frame side are taken.
        kind: Name of the dome (``plate.kinds``).
        lens: "pinhole" or "fisheye".
        gel_index: Refractive index of the gel.
    """
    return Rig(plate(kind), presses.rest, presses.side, lens, gel_index)


def initial_unknowns(presses: Presses) -> Unknowns:
    """Return the start of the fit: the axis amid the pins, the focal length scaled to the frame."""
    x, y = presses.rest.mean(axis=0)
    begin = Unknowns(centre_x=float(x), centre_y=float(y))
    return replace(begin, focal_px=begin.focal_px * presses.side / 360)


def fit(
    presses: Presses,
    rig: Rig,
    begin: Unknowns,
    free: Sequence[str] = ALL,
    *,
    states: bool = True,
    steps: int = 30,
) -> tuple[Unknowns, float]:
    """Fit the unknowns by the least sum over presses of ||sim - real|| / ||real||.

    The sum is of norms and not of squares, so that one press with a wrong label weighs no more than
    any other.

    Args:
        presses: Presses to fit to.
        rig: The parts that are not fitted.
        begin: Where the fit begins.
        free: Names of the unknowns that are fitted.
        states: Take each press as dragged or as not dragged, whichever fits better. False: take all
            as dragged.
        steps: Evaluations of the residuals, at most.

    Returns:
        The unknowns and the mean relative error.
    """
    fewer = replace(rig, rest=rig.rest[::EVERY])
    real = presses.moved[:, ::EVERY]
    weight = 1 / np.sqrt(np.nansum(real**2, axis=(1, 2)))
    origin = np.array([getattr(begin, name) for name in free])
    step = np.array([STEP[name] for name in free])
    limits = np.array([BOUNDS.get(name, (-np.inf, np.inf)) for name in free])

    def residuals(vector: Array) -> Array:
        x = _with(begin, free, origin + step * vector)
        best: Array | None = None
        for dragged in (1.0, 0.0) if states else (1.0,):
            sim = displacements(fewer, x, presses.labels, np.full(len(presses), dragged))
            off = np.nan_to_num((sim - real) * weight[:, None, None]).reshape(len(real), -1)
            if best is None:
                best = off
            else:
                better = (off**2).sum(axis=1) < (best**2).sum(axis=1)
                best = np.where(better[:, None], off, best)
        assert best is not None  # noqa: S101 - there is a state
        error = np.sqrt((best**2).sum(axis=1) + _SOFT**2)
        return np.asarray((best / np.sqrt(error)[:, None]).ravel(), dtype=np.float64)

    low, high = ((limits - origin[:, None]) / step[:, None]).T
    result = least_squares(residuals, np.zeros(len(free)), bounds=(low, high), max_nfev=steps)
    return _with(begin, free, origin + step * result.x), float(2 * result.cost / len(presses))


def fit_best(presses: Presses, kinds: Sequence[str], steps: int = 30) -> Fit:
    """Return the fit of all unknowns on the dome of ``kinds`` that fits best.

    Args:
        presses: Presses to fit to.
        kinds: Names of domes (``plate.kinds``), at least one.
        steps: Evaluations of the residuals for each dome, at most.
    """
    begin, best = initial_unknowns(presses), None
    for kind in kinds:
        unknowns, loss = fit(presses, rig_of(presses, kind), begin, steps=steps)
        begin = unknowns
        if best is None or loss < best.loss:
            best = Fit(unknowns, kind, loss)
    assert best is not None  # noqa: S101 - kinds is not empty
    return best


def _with(begin: Unknowns, names: Sequence[str], values: Array) -> Unknowns:
    return replace(begin, **dict(zip(names, map(float, values), strict=True)))
