"""Make the file of sideways drag from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_drag.py OUT RUNS

RUNS is a folder that keeps every run, so that an interrupted tabulation goes on where it stopped.
There are 48 runs of a quarter of a minute. A tip is pressed on the apex without friction, sticks
there, and is moved sideways by a tenth of its penetration; the field is the change of the
displacement for each unit of sideways force. It goes with cos and sin of the azimuth (a mirror
plane and a small move leave nothing else); other orders, which grow with the move squared, are
projected out.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
from elements import Dome
from fem_script import output_file, report_progress, solver, write_file, write_tables
from scipy.interpolate import make_lsq_spline
from spatial import Drag, Fineness, SpatialPress, Tip

from tactibench_sim import RADIUS_MM, SHARES, deepest_of, shape_name, shipped_dome

Array = npt.NDArray[np.float64]
RADII = (1.0, 2.0, 3.0, 5.0, 8.0, math.inf)
MOVE_SHARE, LEAST_MOVE_MM, MOST_MOVE_MM = 0.1, 0.05, 0.25
SHARP_MM, SHARP, ROUND = 3.0, Fineness(contact=0.2, margin=1.0), Fineness(contact=0.3, largest=1.5)
"""Tips of a radius below the first get the second mesh, all others the third. Elements of 0.2 R
instead of 0.3 R change the sideways stiffness under R = 3 mm by 1 %."""
SAMPLE_STEP_DEG, AZIMUTHS, POLAR_STEP_DEG = 0.5, 12, 1.0
FINE_KNOTS_DEG, COARSE_KNOTS_DEG, FINE_TO_DEG = 1.5, 4.0, 24.0
"""Knots of the splines that smooth the mesh away: narrow about the contact, wide beyond it."""
_ABOVE_RIM_DEG = 89.5


def end_of(radius: float) -> float:
    """Return the greatest penetration to which a tip of radius ``radius`` mm is tabulated, mm."""
    if math.isinf(radius) or radius == RADIUS_MM:
        return float(shipped_dome().by_radius[radius].delta[-1])
    return deepest_of(radius)


def tabulate(path: Path, runs: Path) -> str:
    """Make the runs that are missing in a folder, write the file and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        runs: Folder of the runs; it is made where it does not exist.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: A run failed.
    """
    runs.mkdir(parents=True, exist_ok=True)
    dome = Dome()
    fields, compliance = [], []
    for radius in RADII:
        each = []
        for share in SHARES:
            name = f"{shape_name(radius)}_{share:g}"
            file = runs / f"drag_{name}.npz"
            if not file.exists():
                report_progress(name)
                change, force, moved = drag(dome, radius, share * end_of(radius))
                write_tables(file, {"change": change, "force": np.array(force), "moved": moved}, {})
            with np.load(file) as run:
                each.append((smoothed(run["change"] / run["force"]), run["moved"] / run["force"]))
        fields.append([field for field, _ in each])
        compliance.append([float(soft) for _, soft in each])
    arrays = {
        "field": np.array(fields, dtype=np.float32),
        "compliance": np.array(compliance),
        "radii": np.array(RADII),
        "deepest": np.array([end_of(radius) for radius in RADII]),
    }
    parameters = {
        "dome": asdict(dome),
        "mesh": {"sharp": asdict(SHARP), "round": asdict(ROUND)},
        "polar_step_deg": POLAR_STEP_DEG,
        "solver": solver(),
    }
    return write_tables(path, arrays, parameters)


def drag(dome: Dome, radius: float, depth: float) -> tuple[Array, float, Array]:
    """Press a tip on the apex and move it sideways, stuck to the skin.

    Args:
        dome: Dome that is pressed.
        radius: Radius of the tip, mm; inf: a plate.
        depth: Penetration, mm.

    Returns:
        The (2, 3, T) change of the displacement of the inner and the outer skin, mm: inward and
        away from the contact, which go with cos, and along the circle of latitude, which goes with
        sin. Then the sideways force, E_skin mm^2, and the move as an array of no axis, mm.
    """
    tip = Tip.along_axis(dome, np.array([0.0, 0.0, 1.0]), radius)
    fineness = SHARP if radius < SHARP_MM else ROUND
    press = SpatialPress(dome, [tip], np.array([[depth]]), mirror=True, fineness=fineness)
    press.move(np.array([depth]))
    before = first_order(press)
    pulled = Drag(press, np.array([1.0, 0.0]))
    move = min(max(MOVE_SHARE * depth, LEAST_MOVE_MM), MOST_MOVE_MM)
    pulled.move(move)
    return first_order(press) - before, pulled.force(), np.array(move)


def first_order(press: SpatialPress) -> Array:
    """Return the (2, 3, T) first Fourier order of the present displacement, mm, as in ``drag``."""
    field = press.field()
    polar, azimuth = np.radians(samples())[:, None], (np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS
    sine, cosine = np.sin(polar) + 0 * azimuth, np.cos(polar) + 0 * azimuth
    out = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    down = np.stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), -sine], axis=-1)
    along = np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * azimuth], axis=-1) + 0 * out
    skins = []
    for displacement in (field.inner, field.outer):
        u = displacement(out.reshape(-1, 3)).reshape(out.shape)
        inward, away, around = (np.einsum("tpk,tpk->tp", u, axis) for axis in (-out, down, along))
        orders = (inward * np.cos(azimuth), away * np.cos(azimuth), around * np.sin(azimuth))
        skins.append([2 * order.mean(axis=1) for order in orders])
    return np.array(skins)


def samples() -> Array:
    """Return the (T,) polar angles at which a run is sampled, deg."""
    return np.arange(SAMPLE_STEP_DEG / 2, _ABOVE_RIM_DEG, SAMPLE_STEP_DEG)


def smoothed(field: Array) -> Array:
    """Return a (2, 3, T) field at the polar angles of the table, by smoothing splines.

    The fit is by least squares on the angle and its mirror image: the inward component is odd about
    the contact, the others are even. At the clamped rim all are 0.

    Args:
        field: (2, 3, T') field at the polar angles of ``samples``.
    """
    at = samples()
    degrees = np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG
    inner = np.concatenate(
        [
            np.arange(FINE_KNOTS_DEG, FINE_TO_DEG, FINE_KNOTS_DEG),
            np.arange(FINE_TO_DEG, 90.0 - COARSE_KNOTS_DEG / 2, COARSE_KNOTS_DEG),
        ]
    )
    knots = np.concatenate([[-90.0] * 4, -inner[::-1], [0.0], inner, [90.0] * 4])
    out = np.empty((*field.shape[:2], len(degrees)))
    for where in range(2):
        for k, parity in enumerate((-1.0, 1.0, 1.0)):
            values = np.append(field[where, k], 0.0)
            angle = np.append(at, 90.0)
            mirrored = np.concatenate([parity * values[::-1], values])
            spline = make_lsq_spline(np.concatenate([-angle[::-1], angle]), mirrored, knots)
            out[where, k] = spline(degrees)
    out[..., -1] = 0.0
    out[:, 0, 0] = 0.0
    return out


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make the tables of sideways drag.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("runs", type=Path)
    given = parser.parse_args()
    write_file(given.out, lambda: tabulate(given.out, given.runs))


if __name__ == "__main__":
    main()
