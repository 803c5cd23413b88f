"""Three-dimensional runs from which the corrections of a table are learned, kept in a folder.

Each run has a file, written when the run is complete, so that an interrupted tabulation goes on
with the next run. A file holds

* ``u``: (S, 2, A, B, 3) displacement of the inner and the outer skin along e, f, m at the nodes of
  a chart (see ``modes.Chart``), mm; NaN below the dome's rim;
* ``a``, ``b``: (A,) and (B,) nodes of the chart, deg;
* ``d``: (S,) penetrations of one contact or (S, 2) of two, mm;
* ``radius``: radius of the indenter, mm;
* ``beta``: polar angle of one contact, or ``alpha``: angle between two contacts, rad;
* ``parameters``: dome, mesh, contact and solver of the run, as JSON.

All 14 runs of a sphere and a plate take up to an hour of one core.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
from learn import Pair, Single, corrections_from
from modes import Chart

from tactibench import UserError
from tactibench.lab import atomic
from tactibench_sim import data_file, fem
from tactibench_sim.fem.field import SpatialField
from tactibench_sim.fem.press import Fineness, SpatialPress
from tactibench_sim.fem.tip import PLATE, SPHERE, Tip
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.tip_tables import deepest

Array = npt.NDArray[np.float64]

BETAS_DEG = (0.0, 20.0, 40.0, 55.0)
DEPTHS_MM = tuple(0.5 * k for k in range(1, 14))
ANGLES_DEG = (9.0, 14.0, 18.5, 24.0, 31.0, 40.0)
PLATE_DEPTHS_MM = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ENOUGH_MM = 4.0
"""A run of a single contact that fails beyond this depth keeps the depths that it reached: a plate
at 55 deg meets the clamped rim at about 5 mm, and no finite-element run goes on from there."""
PAIR_DEPTHS_MM = (0.75, 1.75, 3.0, 4.5, 6.25)
NOMINAL_MM = 3.0
"""Radius of the tips of the published experiments: the only ones that are tabulated to 6.5 mm."""
OTHER_DEPTHS = tuple((k + 1) / 6 for k in range(6))
OTHER_PAIR_DEPTHS = (0.15, 0.4, 0.7, 1.0)
"""Shares of the greatest depth."""
OTHER_ANGLES_DEG = (5.5, 9.0, 14.0, 18.5, 24.0, 31.0, 40.0)
"""Two tips of R = 1 mm stand 5.5 deg apart where their spheres touch each other."""
SINGLE_CHART = Chart(start=-120.0, reach=120.0, across=120.0, step=2.5)
PAIR_CHART = Chart(start=-75.0, reach=75.0, across=75.0, step=2.5)
_RIM = 1e-3  # height above the base, dome radii, below which there is no skin


@dataclass(frozen=True)
class Run:
    """A run of one contact, or of two contacts on both sides of the apex.

    Attributes:
        radius: Radius of the indenters, mm; inf: a plate.
        degrees: Angle of one contact from the apex, or between two contacts, deg.
        pair: Whether there are two contacts.
    """

    radius: float
    degrees: float
    pair: bool

    @property
    def name(self) -> str:
        """Name of the run's file."""
        return f"{'pair_' if self.pair else ''}{tables.shape_name(self.radius)}_{self.degrees:g}"

    @property
    def chart(self) -> Chart:
        """Places where the run is sampled."""
        return PAIR_CHART if self.pair else SINGLE_CHART

    def tips(self, dome: fem.Dome) -> tuple[Tip, ...]:
        """Return the indenters."""
        turns = (-self.degrees / 2, self.degrees / 2) if self.pair else (self.degrees,)
        return tuple(Tip.along_axis(dome, _tilted(turn), self.radius) for turn in turns)

    def depths(self) -> Array:
        """Return the (S, K) depths in order, mm.

        Those of pairs go to and fro row by row, so that steps are short; no second tip is deeper
        than the first.
        """
        if not self.pair:
            return np.array(self._single_depths())[:, None]
        way: list[tuple[float, float]] = []
        depths = self._pair_depths()
        for k, first in enumerate(depths):
            row = [(first, second) for second in depths[: k + 1]]
            way += row[:: (-1) ** k]
        return np.array(way)

    def _single_depths(self) -> tuple[float, ...]:
        if math.isinf(self.radius):
            return PLATE_DEPTHS_MM
        if self.radius == NOMINAL_MM:
            return DEPTHS_MM
        return tuple(share * deepest(self.radius) for share in OTHER_DEPTHS)

    def _pair_depths(self) -> tuple[float, ...]:
        if self.radius == NOMINAL_MM:
            return PAIR_DEPTHS_MM
        return tuple(share * deepest(self.radius) for share in OTHER_PAIR_DEPTHS)

    def frame(self) -> Array:
        """Return the (3, 3) unit vectors e, f, m of the run, as rows."""
        m = _tilted(0.0 if self.pair else self.degrees)
        return np.array([[m[2], 0.0, -m[0]], [0.0, 1.0, 0.0], m])


def plan(radii: Sequence[float]) -> tuple[Run, ...]:
    """Return the runs for a table: singles of each radius, mm, and pairs of the smallest sphere."""
    singles = [Run(radius, degrees, False) for radius in radii for degrees in BETAS_DEG]
    spheres = [radius for radius in radii if math.isfinite(radius)]
    pairs = [Run(radius, degrees, True) for radius in sorted(spheres)[:1] for degrees in ANGLES_DEG]
    return tuple(singles + pairs)


def tip_plan(radii: Sequence[float], pair_radii: Sequence[float]) -> tuple[Run, ...]:
    """Return the runs for tips other than the nominal one.

    Args:
        radii: Radii of single contacts, mm.
        pair_radii: Radii of pairs, mm.
    """
    singles = [Run(radius, degrees, False) for radius in radii for degrees in BETAS_DEG]
    pairs = [
        Run(radius, degrees, True)
        for radius in pair_radii
        for degrees in OTHER_ANGLES_DEG
        if radius < NOMINAL_MM or degrees in ANGLES_DEG
    ]
    return (*singles, *pairs)


def states(run: Run, dome: fem.Dome) -> Iterator[Array]:
    """Yield the (2, A, B, 3) displacement of every state of a run, mm, as ``sampled`` gives it.

    Raises:
        NotConvergedError: The run failed.
    """
    press = SpatialPress(dome, run.tips(dome), run.depths(), mirror=True)
    for row in run.depths():
        press.move(row)
        yield sampled(press.field(), run)


def sampled(field: SpatialField, run: Run) -> Array:
    """Return the (2, A, B, 3) displacement of both skins along e, f, m at the chart's nodes, mm.

    It is NaN below the dome's rim.
    """
    frame = run.frame()
    directions = run.chart.directions() @ frame
    on_skin = directions[..., 2] > _RIM
    out = np.full((2, *directions.shape), np.nan)
    for skin, displacement in enumerate((field.inner, field.outer)):
        out[skin][on_skin] = displacement(directions[on_skin]) @ frame.T
    return out


def make(
    folder: Path,
    dome: fem.Dome,
    runs: Sequence[Run],
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Single], list[Pair]]:
    """Return the single contacts and the pairs of a folder's runs; missing runs are made.

    Args:
        folder: Folder of the runs; it is made where it does not exist.
        dome: Dome that is pressed.
        runs: Runs that are wanted.
        progress: Function that is told the name of each missing run before it starts.

    Raises:
        NotConvergedError: A run failed (see ENOUGH_MM).
        UserError: NGSolve is not installed, or a file cannot be read or is of another dome or mesh.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parameters = _parameters(dome)
    contacts = []
    for run in runs:
        path = folder / f"{run.name}.npz"
        if not path.exists():
            progress(run.name)
            _write(path, run, _reached(run, dome), parameters)
        contacts.append(read(path, parameters))
    singles = [contact for contact in contacts if isinstance(contact, Single)]
    return singles, [contact for contact in contacts if isinstance(contact, Pair)]


def _reached(run: Run, dome: fem.Dome) -> Array:
    """Return the (S, 2, A, B, 3) states of a run: all of a pair, those reached of one contact.

    Raises:
        NotConvergedError: A run of a pair failed, or one of a single contact before ENOUGH_MM.
    """
    reached: list[Array] = []
    try:
        for state in states(run, dome):
            reached.append(state)  # noqa: PERF402  (kept where the next one fails)
    except fem.NotConvergedError:
        if run.pair or not reached or run.depths()[len(reached) - 1, 0] < ENOUGH_MM:
            raise
    return np.array(reached)


def _write(path: Path, run: Run, u: Array, parameters: Mapping[str, Any]) -> None:
    content: dict[str, Any] = {
        "a": run.chart.a,
        "b": run.chart.b,
        "u": u.astype(np.float32),
        "d": run.depths() if run.pair else run.depths()[: len(u), 0],
        "radius": run.radius,
        "alpha" if run.pair else "beta": math.radians(run.degrees),
        "parameters": json.dumps(parameters, sort_keys=True),
    }
    with atomic(path) as out:
        np.savez_compressed(out, **content)


def read(path: Path, parameters: Mapping[str, Any]) -> Single | Pair:
    """Return the run that a file holds.

    Raises:
        UserError: The file cannot be read, or its run was made with other ``parameters``.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
        given = json.loads(str(content["parameters"]))
        pair = "alpha" in content
        angle, radius = float(content["alpha" if pair else "beta"]), float(content["radius"])
        d, u = content["d"].astype(np.float64), content["u"].astype(np.float64)
        a, b = content["a"], content["b"]
        chart = Chart(float(a[0]), float(a[-1]), float(b[-1]), float(b[1] - b[0]))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UserError(
            f"the finite-element run {path} cannot be read ({type(error).__name__}); "
            "delete it and start again."
        ) from None
    if _comparable(given) != _comparable(parameters):
        raise UserError(
            f"the finite-element run {path} is of another dome or mesh; give another folder."
        )
    return Pair(radius, angle, d, chart, u) if pair else Single(radius, angle, d, chart, u)


def with_corrections(
    arrays: Mapping[str, npt.NDArray[Any]],
    parameters: Mapping[str, Any],
    dome: fem.Dome,
    folder: Path,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
    """Return arrays and parameters of a table file, with corrections learned from runs.

    Args:
        arrays: Arrays of the file without corrections.
        parameters: Parameters of the file without corrections.
        dome: Dome that is pressed.
        folder: Folder of the runs; missing runs are made.
        progress: Function that is told the name of each missing run before it starts.

    Raises:
        NotConvergedError: A run failed (see ENOUGH_MM).
        UserError: NGSolve is not installed, or a file cannot be read or is of another dome or mesh.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data_file.write(folder / "plain.npz", arrays, dict(parameters))
    plain = tables.read(folder / "plain.npz")
    singles, pairs = make(folder, dome, plan(tuple(plain.by_radius)), progress)
    learned = corrections_from(singles, pairs, plain)
    more = {name: values.astype(np.float32) for name, values in learned.arrays.items()}
    spatial = {key: value for key, value in _parameters(dome).items() if key != "dome"}
    return {**arrays, **more}, {
        **parameters,
        "corrections": dict(learned.grid),
        "spatial": spatial,
    }


def _parameters(dome: fem.Dome) -> dict[str, Any]:
    ngsolve = fem.require_ngsolve()
    solver = f"ngsolve {ngsolve.__version__}"
    return {
        "dome": asdict(dome),
        "mesh": asdict(Fineness()),
        "contact": {"sphere": asdict(SPHERE), "plate": asdict(PLATE)},
        "solver": solver,
    }


def _comparable(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters without the solver: runs may be continued with another version of it."""
    return {key: value for key, value in parameters.items() if key != "solver"}


def _tilted(degrees: float) -> Array:
    angle = math.radians(degrees)
    return np.array([math.sin(angle), 0.0, math.cos(angle)])
