"""Make the planar sensor's table file from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_pad.py OUT [--radius R ...]

Give OUT to the sensor with --param sensor.table=OUT.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fem_script import number, output_file, report_progress, write_file
from pad_press import Pad, press_pad

from tactibench_sim import data_file
from tactibench_sim.fem.body import require_ngsolve
from tactibench_sim.fem.continuation import NotConvergedError, Settings
from tactibench_sim.mechanics.tables import SMALLEST_MM
from tactibench_sim.planar.mechanics import QUANTITIES

Array = npt.NDArray[np.float64]

PAD = Pad(
    thickness=5.0,
    skin=0.0,
    stiffness_ratio=1.0,
    width=120.0,
    marker_depth=0.5,
    contact_size=0.1,
    contact_radius=5.0,
    gel_size=1.0,
    penalty=500.0,
)
"""Gel alone, so that forces are in its own modulus; 5 mm thick and without a stiff coat (assumed;
the gel of a GelSight Mini is 4.5 mm in the simulator TacEx). Markers half a millimetre deep, under
a cover (assumed). Wide enough for its bulge, which decays by e every 5 mm / 0.739 = 6.8 mm."""

DEEPEST_MM, STEP_MM = 3.0, 0.125
"""Greatest penetration, which is the radius of the protocols' tips, and its step. Beyond it a rod's
wall shears the surface: runs stopped at 3.3 to 3.5 mm on every mesh that was tried."""
FARTHEST_MM, R_STEP_MM = 45.0, 0.1
STEPS_MM = (0.05, 0.025, 0.0125)
"""Largest increments, tried in turn: after a long increment a surface element may be folded."""
FOLD_MM = 0.05
"""Third difference of the surface between nodes: 0.02 at most while smooth, 0.2 at a fold."""


def tabulate(
    path: Path,
    pad: Pad = PAD,
    radii: Sequence[float] = (3.0,),
    progress: Callable[[str], None] = lambda _: None,
    deepest: float | None = None,
) -> str:
    """Press spheres of every radius, write the file of their tables and return its digest.

    Nothing is written unless every run converged.

    Args:
        path: File to write.
        pad: Pad that is pressed.
        radii: Radii of the spheres, mm.
        progress: Function that is told the name of each run before it starts.
        deepest: Greatest penetration, mm; None: DEEPEST_MM, or the smallest radius if that is less.

    Raises:
        UserError: NGSolve is not installed, or a radius is infinite.
        fem.NotConvergedError: A run failed.
    """
    ngsolve = require_ngsolve()
    delta = _steps(min(DEEPEST_MM, *radii) if deepest is None else deepest, STEP_MM)
    r = _steps(FARTHEST_MM, R_STEP_MM)
    columns: dict[str, list[Array]] = {quantity: [] for quantity in QUANTITIES}
    ordered = sorted(radii)
    for radius in ordered:
        progress(f"sphere of {radius:g} mm")
        for quantity, values in press(pad, radius, delta, r).items():
            columns[quantity].append(values)
    arrays: dict[str, npt.NDArray[Any]] = {"radii": np.array(ordered), "delta": delta, "r": r}
    for quantity, rows in columns.items():
        arrays[quantity] = np.stack(rows).astype(np.float32)
    return data_file.write(
        path, arrays, {"pad": asdict(pad), "solver": f"ngsolve {ngsolve.__version__}"}
    )


def _steps(last: float, step: float) -> Array:
    return np.asarray(np.arange(int(last / step + 1e-9) + 1) * step, dtype=np.float64)


def press(pad: Pad, radius: float, delta: Array, r: Array) -> dict[str, Array]:
    """Return the quantities of one tip: (D, N) each, mm; force (D,), E_skin mm^2.

    Args:
        pad: Pad that is pressed.
        radius: Radius of the sphere, mm.
        delta: (D,) penetrations, mm.
        r: (N,) distances from the axis, mm.

    Raises:
        fem.NotConvergedError: A run failed, or the surface folded with every increment.
    """
    for largest in STEPS_MM:
        settings = Settings(cap=0.1, largest=largest, steps=40, smallest=2e-4)
        profiles = list(press_pad(pad, radius, delta, r, settings=settings))
        w_surface, t_surface = np.stack([profile.surface for profile in profiles], axis=1)
        if abs(np.diff(w_surface, n=3, axis=1)).max() < FOLD_MM:
            w, t = np.stack([profile.marker for profile in profiles], axis=1)
            force = np.array([profile.force for profile in profiles])
            return dict(zip(QUANTITIES, (w, t, w_surface, t_surface, force), strict=True))
    raise NotConvergedError(f"the pad's surface folded under a sphere of {radius:g} mm")


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make tables of a flat pad under single tips.")
    parser.add_argument("out", type=output_file)
    parser.add_argument(
        "--radius", type=number(SMALLEST_MM), action="append", help="of a tip, mm (default: 3)"
    )
    parser.add_argument("--stiffness-ratio", type=number(1, 10_000), help="E_skin / E_gel")
    parser.add_argument("--skin", type=number(0.3, 4), help="thickness, mm")
    given = parser.parse_args()
    settings = {"stiffness_ratio": given.stiffness_ratio, "skin": given.skin}
    pad = replace(PAD, **{name: value for name, value in settings.items() if value is not None})
    radii = given.radius or (3.0,)
    write_file(given.out, lambda: tabulate(given.out, pad, radii, report_progress))


if __name__ == "__main__":
    main()
