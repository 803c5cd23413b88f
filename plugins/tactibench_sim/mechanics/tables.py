"""The tabulated single-contact fields: one small file with parameters and hash.

Quantities, by ``[depth, polar angle from the contact]``: displacement of the pin bases on the inner
skin (``w`` inward, ``t`` tangential away from the contact, mm), rotation ``omega`` of the inner
surface's normal (rad), displacement of the outer skin (``w_outer``, ``t_outer``, mm); by depth:
``force`` (E_skin mm^2). The polar angle runs from 0 to 90 deg; the clamped rim ends the table and
beyond it everything is zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim import data_file
from tactibench_sim.mechanics.corrections import Corrections

FILE = "dome.npz"
QUANTITIES = ("w", "t", "omega", "w_outer", "t_outer", "force")
SMALLEST_MM, LARGEST_MM = 1.0, 8.0
"""Radii of the tips of which tables ship (``tip_tables``); scripts make no smaller ones."""
SCRIPT = "scripts/fem/tabulate_dome.py"
"""Script that makes the file; it is in the repository and not in the package."""


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
    delta: npt.NDArray[np.float64]
    polar: npt.NDArray[np.float64]
    fields: Mapping[str, npt.NDArray[np.float64]]

    @property
    def deepest(self) -> float:
        """Greatest tabulated penetration, mm."""
        return float(self.delta[-1])


@dataclass(frozen=True, eq=False)
class Tables:
    """The content of a table file.

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


def _tables(arrays: data_file.Arrays, parameters: dict[str, Any], digest: str) -> Tables:
    delta, polar = (arrays[name].astype(np.float64) for name in ("delta", "polar"))
    by_radius = {}
    shapes = sorted(name.removesuffix("_force") for name in arrays if name.endswith("_force"))
    for shape in shapes:
        radius = math.inf if shape == "plate" else float(shape.removeprefix("sphere"))
        fields = {q: arrays[f"{shape}_{q}"].astype(np.float64) for q in QUANTITIES}
        by_radius[radius] = Table(radius, delta, polar, fields)
    corrections = Corrections.from_arrays(arrays, parameters.get("corrections"))
    return Tables(parameters, digest, by_radius, corrections)


@lru_cache(maxsize=8)
def holding_plates(nominal: Tables) -> Tables:
    """Return the tables for plates that hold the skin (``Corrections.without_plates``)."""
    return replace(nominal, corrections=nominal.corrections.without_plates())


DATA = data_file.DataFile(__package__, FILE, "the simulator's table", _tables, SCRIPT)
read, shipped = DATA.read, DATA.shipped
