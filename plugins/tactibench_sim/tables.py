"""Tables of the simulator: files of arrays with parameters, and the fields of contacts in them.

A file holds a few arrays, the parameters of the finite-element runs that made them, and a digest
over both. Files that ship stand in the folder ``data``; the scripts of scripts/fem make them.

Quantities of a single contact, by ``[depth, polar angle from the contact]``: displacement of the
pin bases on the inner skin (``w`` inward, ``t`` tangential away from the contact, mm), rotation
``omega`` of the inner surface's normal (rad), displacement of the outer skin (``w_outer``,
``t_outer``, mm); by depth: ``force`` (E_skin mm^2). The polar angle runs from 0 to 90 deg; the
clamped rim ends the table and beyond it everything is zero.

dome.npz has a tip of R = 3 mm, as the published experiments press, and a plate. tips.npz has single
contacts of nine radii, what the rim changes for each of them, and pairs of equal tips for some.
Everything between is a cubic spline in log R: single fields at one penetration, corrections at one
share of the greatest penetration. A radius that was computed is met exactly.

A correction is a *patch*: a small field around a middle direction m, given in the frame (e, f, m),
where e points down the dome's side or from one contact to the other and the plane of e and m is a
mirror plane. Positions are Lambert's equal-area coordinates: a point at the angle r from m in the
direction (cos, sin) of the tangent plane lies at 2 sin(r / 2) (cos, sin). Vectors are kept by their
components along e, f, m, so nothing is singular at the middle. A patch is a linear combination of a
few fixed modes: the amounts are cubic splines of the contact's parameters, the modes cubic splines
of the position, so that everything is twice continuously differentiable and ends smoothly.
"""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.kernels import Around, Modes, Pairs

Array = npt.NDArray[np.float64]
SIX = 6  # displacement and turn of the normal, along three axes
QUANTITIES = ("w", "t", "omega", "w_outer", "t_outer", "force")
RADIUS_MM = 3.0
"""Radius of the nominal tip, which has tables of its own."""
SMALLEST_MM, LARGEST_MM = 1.0, 8.0
"""Radii of the tips of which tables ship; scripts make no smaller ones."""
DEEPEST_MM, DEEPEST_RADII = 4.0, 1.5
"""Tips other than the nominal one are tabulated to 4 mm, but at most to 1.5 of their radii: sharper
presses turn elements of the skin inside out."""
SHARES = 8
"""Steps of the corrections of other tips from no penetration to the greatest."""
QUANTUM = 2e-4
"""Step, mm and rad: single fields of other tips are stored as whole multiples of it, which reach
6.5 mm in two bytes."""


@dataclass(frozen=True, eq=False)
class TableFile:
    """The content of a file.

    Attributes:
        arrays: Name -> array, float64.
        parameters: Parameters of the runs that made the arrays.
        digest: Checksum of both.
    """

    arrays: Mapping[str, Array]
    parameters: dict[str, Any]
    digest: str


def read_file(path: Path) -> TableFile:
    """Read a file of tables.

    Raises:
        UserError: It is unreadable or no such file.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        parameters, digest = json.loads(str(arrays.pop("parameters"))), str(arrays.pop("sha256"))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error) as error:
        raise UserError(
            f"the simulator's table {path} cannot be read ({type(error).__name__}); make it again "
            "with its script of scripts/fem, or reinstall tactibench."
        ) from None
    return TableFile({k: v.astype(np.float64) for k, v in arrays.items()}, parameters, digest)


@cache
def shipped_file(name: str) -> TableFile:
    """Return the content of a file that ships, the same object at every call."""
    with as_file(files(__package__) / "data" / name) as path:
        return read_file(path)


def digest_of(arrays: Mapping[str, npt.NDArray[Any]], parameters: str) -> str:
    """Return the sha256 over the parameters and every array's name, type, shape and bytes."""
    total = hashlib.sha256(parameters.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


@dataclass(frozen=True, eq=False)
class Table:
    """The fields of one indenter.

    Attributes:
        radius: Radius, mm; inf for a plate.
        delta: (D,) penetrations, mm, from 0, uniform.
        polar: (T,) polar angles, rad, from 0, uniform.
        fields: Quantity -> (D, T), ``force`` -> (D,).
    """

    radius: float
    delta: Array
    polar: Array
    fields: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Tables:
    """The fields of one dome.

    Attributes:
        parameters: Parameters of the finite-element runs, ``dome`` among them.
        digest: Checksum of the file.
        by_radius: Radius, mm -> fields of that indenter; inf: a plate.
        corrections: Corrections for the rim and for pairs.
    """

    parameters: dict[str, Any]
    digest: str
    by_radius: Mapping[float, Table]
    corrections: Corrections


def shape_name(radius: float) -> str:
    """Return the name of an indenter in the file, to six digits: sphere3, sphere2.5, plate."""
    return "plate" if math.isinf(radius) else f"sphere{radius:g}"


def dome_tables(file: TableFile) -> Tables:
    """Return the tables of a dome that a file holds."""
    arrays, by_radius = file.arrays, {}
    shapes = sorted(name.removesuffix("_force") for name in arrays if name.endswith("_force"))
    for shape in shapes:
        radius = math.inf if shape == "plate" else float(shape.removeprefix("sphere"))
        fields = {q: arrays[f"{shape}_{q}"] for q in QUANTITIES}
        by_radius[radius] = Table(radius, arrays["delta"], arrays["polar"], fields)
    names = [name for name in arrays if name.startswith(("around_", "pair_"))]
    grid = file.parameters.get("corrections", {})
    corrections = Corrections({name: arrays[name] for name in names} if grid else {}, grid)
    return Tables(file.parameters, file.digest, by_radius, corrections)


@cache
def shipped_dome() -> Tables:
    """Return the tables of the nominal dome."""
    return dome_tables(shipped_file("dome.npz"))


def deepest_of(radius: float) -> float:
    """Return the greatest penetration of a tip other than the nominal one, mm."""
    return min(DEEPEST_MM, DEEPEST_RADII * radius)


def tip_tables(radius: float) -> Tables:
    """Return the tables of one tip on the nominal dome.

    tips.npz holds (K,) ``radii`` and (L,) ``pair_radii``, mm; (K, D, T) fields and (K, D) forces;
    modes as in ``Corrections``, shared by all radii; ``around_amounts`` (K, B + 2, SHARES + 3, R)
    and ``pair_amounts`` (L, A + 2, SHARES + 3, SHARES + 3, R).

    Args:
        radius: Radius of the tip, mm.

    Raises:
        UserError: The radius is not between SMALLEST_MM and LARGEST_MM.
    """
    if not SMALLEST_MM <= radius <= LARGEST_MM:
        raise UserError(
            f"the tip's radius is {radius:g} mm; the simulator has tables for {SMALLEST_MM:g} to "
            f"{LARGEST_MM:g} mm: take such a tip."
        )
    file = shipped_file("tips.npz")
    arrays, end = file.arrays, deepest_of(radius)
    delta = np.linspace(0.0, end, math.ceil(end / float(arrays["delta"][1]) - 1e-9) + 1)
    fields = {}
    for name in QUANTITIES:
        scale = 1.0 if name == "force" else QUANTUM
        field = between(arrays["radii"], arrays[name] * scale, radius)
        fields[name] = CubicSpline(arrays["delta"], field, axis=0)(delta)
    patches = {name: modes for name, modes in arrays.items() if name.endswith("_modes")}
    patches["around_amounts"] = between(arrays["radii"], arrays["around_amounts"], radius)[None]
    patches["pair_amounts"] = between(arrays["pair_radii"], arrays["pair_amounts"], radius)
    grid = {
        **file.parameters["corrections"],
        "around_radii": [radius],
        "pair_radius": radius,
        "depth_step": end / SHARES,
    }
    return Tables(
        {**file.parameters, "radius": radius},
        digest_of({}, f"{file.digest} {radius!r}"),
        {radius: Table(radius, delta, arrays["polar"], fields)},
        Corrections(patches, grid),
    )


def between(radii: Array, values: Array, radius: float) -> Array:
    """Return values at one radius, by a cubic spline in log R; a node is met exactly.

    Args:
        radii: (K,) nodes, mm.
        values: (K, ...) values at the nodes.
        radius: Radius, mm.
    """
    rows = np.flatnonzero(radii == radius)
    if len(rows):
        return np.asarray(values[rows[0]], dtype=np.float64)
    spline = CubicSpline(np.log(radii), values, axis=0)
    return np.asarray(spline(math.log(radius)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Corrections:
    """O and C of ``kernels``, as far as a file has them.

    Attributes:
        arrays: ``{around,pair}_{base,skin}_modes`` (R, A + 2, B + 2, 6), ``around_amounts``
            (M, B + 2, D + 2, R) and ``pair_amounts`` (A + 2, D + 2, D + 2, R), all spline
            coefficients.
        grid: ``around_radii`` (M,), ``pair_radius``, ``pair_even`` (the number of even modes), and
            steps and starts: of patches in chords, of amounts in rad and mm.
    """

    arrays: Mapping[str, Array]
    grid: Mapping[str, Any]

    def around(self, where: str, radii: Sequence[float]) -> Around:
        """Return O for indenters in the given order; zero for those that the file does not have.

        Args:
            where: Surface, "base" or "skin".
            radii: Radii of the indenters, mm; inf for a plate.
        """
        if "around_amounts" not in self.arrays:
            return Around(_no_modes(), np.zeros((len(radii), 4, 4, 4)), 1.0, 1.0)
        tabulated = [np.inf if radius is None else radius for radius in self.grid["around_radii"]]
        table = self.arrays["around_amounts"]
        amounts = np.zeros((len(radii), *table.shape[1:]))
        for index, radius in enumerate(radii):
            if radius in tabulated:
                amounts[index] = _from_nothing(table[tabulated.index(radius)], (0, 1))
        modes = self._modes("around", where)
        return Around(modes, amounts, self.grid["beta_step"], self.grid["depth_step"])

    def pairs(self, where: str, radii: Sequence[float]) -> Pairs:
        """Return C for the one indenter for which the file has it.

        Args:
            where: Surface, "base" or "skin".
            radii: Radii of the indenters, mm; inf for a plate.
        """
        if "pair_amounts" not in self.arrays or self.grid["pair_radius"] not in radii:
            return Pairs(_no_modes(), np.zeros((4, 4, 4, 4)), 1.0, 1.0, -1)
        return Pairs(
            self._modes("pair", where),
            np.ascontiguousarray(
                _exchanged(_from_nothing(self.arrays["pair_amounts"], (0, 1, 2)), self._parity())
            ),
            self.grid["angle_step"],
            self.grid["depth_step"],
            radii.index(self.grid["pair_radius"]),
        )

    def _parity(self) -> Array:
        """Return (R,) 1 for pair modes that stay the same when the contacts swap, -1 for others."""
        count = self.arrays["pair_amounts"].shape[-1]
        return np.where(np.arange(count) < self.grid["pair_even"], 1.0, -1.0)

    def _modes(self, kind: str, where: str) -> Modes:
        grid = self.grid
        modes = self.arrays[f"{kind}_{where}_modes"].copy()
        _mirror(modes)
        if kind == "pair":
            other = modes[:, ::-1] * np.array([-1.0, 1.0, 1.0] * 2)
            modes = (modes + self._parity()[:, None, None, None] * other) / 2
        return Modes(np.ascontiguousarray(modes), grid[f"{kind}_step"], grid[f"{kind}_start"])


def _mirror(modes: Array) -> None:
    """Make b = 0 an exact mirror plane, because the file's numbers are rounded."""
    odd, even = [1, 4], [0, 2, 3, 5]
    modes[:, :, 1, odd] = 0.0
    modes[:, :, 0, odd] = -modes[:, :, 2, odd]
    modes[:, :, 0, even] = modes[:, :, 2, even]


def _from_nothing(amounts: Array, axes: Sequence[int]) -> Array:
    """Make the splines exactly 0 at the first node of each axis."""
    out = amounts.copy()
    for axis in axes:
        along = np.moveaxis(out, axis, 0)  # a view
        along[1] = 0.0
        along[0] = -along[2]
    return out


def _exchanged(amounts: Array, parity: Array) -> Array:
    """Make the amounts exactly even or odd when the contacts swap, as the parity says."""
    mean: Array = (amounts + parity * amounts.swapaxes(1, 2)) / 2
    return mean


def _no_modes() -> Modes:
    return Modes(np.zeros((4, 4, 4, SIX)), 1.0, 10.0)
