"""Domes that differ from the nominal one: tables between computed ones, without finite elements.

Axisymmetric fields were computed for nine domes, three stiffness ratios times three skins, the
middle one being nominal. The file that ships holds what the other eight differ by. A dome between
them is the nominal table plus the differences, quadratic in log ratio and in log skin:

    T(x, y) = T(0, 0) + sum_ij L_i(x) L_j(y) (T_ij - T(0, 0)),      i, j in -1, 0, 1

with x, y in -1..1 of ``instances.made_dome`` and Lagrange's L. So the nominal table is met exactly.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim import sealed
from tactibench_sim.instances import RATIO_FACTOR, SKIN_FACTOR, made_dome
from tactibench_sim.table import QUANTITIES, Table, Tables, shape_of

Array = npt.NDArray[np.float64]
FILE = "domes.npz"
QUANTUM = 1e-4
"""mm and rad; the fields' differences are stored as whole numbers of it."""


@dataclass(frozen=True, eq=False)
class Domes:
    """What domes differ by from the nominal one.

    delta: (D,) mm and polar: (T,) rad, coarser than the tables'. by_shape: name of an indenter ->
    quantity -> (3, 3, D, T) by ratio, skin, depth and angle, ``force`` (3, 3, D); [1, 1] is zero.
    """

    parameters: dict[str, Any]
    digest: str
    delta: Array
    polar: Array
    by_shape: Mapping[str, Mapping[str, Array]]

    def tables(self, nominal: Tables, x: float, y: float, **told: Any) -> Tables:
        """The tables of the dome at (x, y) of ``made_dome``, on the grid of the nominal ones.

        told: further parameters that describe it. The corrections for the rim and for pairs, and
        the bounds of tier auto, are those of the nominal dome, unchanged: they are small beside the
        single fields, and nobody computed what another dome changes of them. Raises UserError where
        ``nominal`` has an indenter that is not in the file, or is of another dome than the file's.
        """
        if (x, y) == (0.0, 0.0):
            return nominal
        known = self.parameters["dome"], sorted(self.by_shape)
        given = nominal.parameters["dome"], sorted(shape_of(r) for r in nominal.by_radius)
        if known != given:
            raise UserError(
                f"the other domes are around {known} and the nominal table is of {given}; "
                "make them again with `tactibench sim tabulate OUT --domes`."
            )
        dome = dict(nominal.parameters["dome"])
        dome["stiffness_ratio"] *= RATIO_FACTOR**x
        dome["skin"] *= SKIN_FACTOR**y
        weight = np.outer(_lagrange(x), _lagrange(y))
        by_radius = {r: self._table(one, weight) for r, one in nominal.by_radius.items()}
        parameters = {**nominal.parameters, "dome": dome, "between": self.digest, **told}
        parts = json.dumps({**parameters, "nominal": nominal.digest}, sort_keys=True)
        return Tables(parameters, sealed.digest_of({}, parts), by_radius, nominal.corrections)

    def _table(self, nominal: Table, weight: Array) -> Table:
        changes = self.by_shape[shape_of(nominal.radius)]
        fields = {}
        for name, field in nominal.fields.items():
            change = np.tensordot(weight, changes[name], 2)
            change = CubicSpline(self.delta, change, axis=0)(nominal.delta)
            if name != "force":
                change = CubicSpline(self.polar, change, axis=1)(nominal.polar)
            fields[name] = field + change
        return Table(nominal.radius, nominal.delta, nominal.polar, fields)


def of_instance(nominal: Tables, instance: int) -> Tables:
    """The tables of instance N of the nominal dome; 0: ``nominal`` itself. See ``Domes.tables``."""
    if instance == 0:
        return nominal
    return shipped().tables(nominal, *made_dome(instance), instance=instance)


def _lagrange(x: float) -> Array:
    """(3,) weights of nodes -1, 0, 1."""
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2])


def read(path: Path) -> Domes:
    """Read a file of domes. Raises UserError where it is unreadable or its hash does not fit."""
    remedy = "reinstall tactibench or make it again with `tactibench sim tabulate OUT --domes`."
    return sealed.read(path, "the tables of other domes", remedy, _domes)


def _domes(arrays: sealed.Arrays, parameters: dict[str, Any], digest: str) -> Domes:
    delta, polar = (arrays[name].astype(np.float64) for name in ("delta", "polar"))
    shapes = [name.removesuffix("_force") for name in arrays if name.endswith("_force")]
    by_shape = {s: {q: _restored(arrays, s, q) for q in QUANTITIES} for s in shapes}
    return Domes(parameters, digest, delta, polar, by_shape)


def _restored(content: Mapping[str, npt.NDArray[Any]], shape: str, quantity: str) -> Array:
    values: Array = content[f"{shape}_{quantity}"].astype(np.float64)
    return values if quantity == "force" else QUANTUM * values


@cache
def shipped() -> Domes:
    """The domes that ship with the package."""
    with as_file(files(__package__).joinpath(FILE)) as path:
        return read(path)
