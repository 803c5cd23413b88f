"""The tabulated single-contact fields: one small file with parameters and hash.

Quantities, by ``[depth, polar angle from the contact]``: displacement of the pin bases on the inner
skin (``w`` inward, ``t`` tangential away from the contact, mm), rotation ``omega`` of the inner
surface's normal (rad), displacement of the outer skin (``w_outer``, ``t_outer``, mm); by depth:
``force`` (E_skin mm^2). The polar angle runs from 0 to 90 deg; the clamped rim ends the table and
beyond it everything is zero.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.corrected import Corrections

FILE = "dome.npz"
QUANTITIES = ("w", "t", "omega", "w_outer", "t_outer", "force")
RADII = (3.0, math.inf)
"""Indenters of the file that ships, mm; inf: a plate."""


@dataclass(frozen=True, eq=False)
class Table:
    """The fields of one indenter.

    radius: mm, inf for a plate. delta: (D,) penetration mm, from 0, uniform. polar: (T,) rad, from
    0, uniform. fields: quantity -> (D, T), ``force`` -> (D,).
    """

    radius: float
    delta: npt.NDArray[np.float64]
    polar: npt.NDArray[np.float64]
    fields: Mapping[str, npt.NDArray[np.float64]]

    @property
    def deepest(self) -> float:
        return float(self.delta[-1])


@dataclass(frozen=True, eq=False)
class Tables:
    """Everything in a table file. parameters: what the finite-element runs were given."""

    parameters: dict[str, Any]
    digest: str
    by_radius: Mapping[float, Table]
    corrections: Corrections


def shape_of(radius: float) -> str:
    """Name of an indenter in the file, to six digits: sphere3, sphere2.5, plate."""
    return "plate" if math.isinf(radius) else f"sphere{radius:g}"


def digest_of(arrays: Mapping[str, npt.NDArray[Any]], parameters: str) -> str:
    """sha256 over the parameters and every array's name, type, shape and bytes, in order."""
    total = hashlib.sha256(parameters.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def write(path: Path, arrays: Mapping[str, npt.NDArray[Any]], parameters: dict[str, Any]) -> str:
    """Write a table file under a temporary name, rename it, and return its digest."""
    text = json.dumps(parameters, sort_keys=True)
    digest = digest_of(arrays, text)
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as out:
        content: dict[str, Any] = {**arrays, "parameters": np.array(text), "sha256": digest}
        np.savez_compressed(out, **content)
    temporary.replace(path)
    return digest


def read(path: Path) -> Tables:
    """Read a table file. Raises UserError where it is unreadable or its hash does not fit."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
        text, told = str(content.pop("parameters")), str(content.pop("sha256"))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UserError(
            f"the simulator's table {path} cannot be read ({type(error).__name__}); "
            "reinstall tactibench or make it again with `tactibench sim tabulate`."
        ) from None
    if digest_of(content, text) != told:
        raise UserError(
            f"the simulator's table {path} does not fit its own hash; "
            "reinstall tactibench or make it again with `tactibench sim tabulate`."
        )
    delta = content["delta"].astype(np.float64)
    polar = content["polar"].astype(np.float64)
    by_radius = {}
    shapes = sorted(name.removesuffix("_force") for name in content if name.endswith("_force"))
    for shape in shapes:
        radius = math.inf if shape == "plate" else float(shape.removeprefix("sphere"))
        fields = {q: content[f"{shape}_{q}"].astype(np.float64) for q in QUANTITIES}
        by_radius[radius] = Table(radius, delta, polar, fields)
    parameters = json.loads(text)
    corrections = Corrections.found(content, parameters.get("corrections"))
    return Tables(parameters, told, by_radius, corrections)


@cache
def shipped() -> Tables:
    """The tables that ship with the package."""
    with as_file(files(__package__).joinpath(FILE)) as path:
        return read(path)
