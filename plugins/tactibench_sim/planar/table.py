"""The tabulated fields of one tip on the flat pad: one small file with parameters and hash.

Quantities, by ``[radius, depth, distance from the tip's axis]``: displacement ``w`` into the pad
and ``t`` away from the axis of the markers, ``w_surface`` and ``t_surface`` of the surface, mm; by
``[radius, depth]``: ``force`` (E_gel mm^2, of a pad with a skin E_skin mm^2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim import sealed

Array = npt.NDArray[np.float64]
FILE = "planar.npz"
QUANTITIES = ("w", "t", "w_surface", "t_surface", "force")


@dataclass(frozen=True, eq=False)
class PadTables:
    """What a table file holds.

    radii: (M,) tips, mm, ascending. delta: (D,) depth mm, from 0, uniform. r: (T,) undeformed
    distance from the axis mm, from 0, uniform. fields: quantity -> (M, D, T), force -> (M, D).
    parameters: what the finite-element run was given, ``pad`` among it.
    """

    parameters: dict[str, Any]
    digest: str
    radii: Array
    delta: Array
    r: Array
    fields: Mapping[str, Array]

    @property
    def thickness(self) -> float:
        """Of the pad, mm."""
        return float(self.parameters["pad"]["thickness"])

    @property
    def marker_depth(self) -> float:
        """Of the markers below the surface, mm."""
        return float(self.parameters["pad"]["marker_depth"])

    @property
    def deepest(self) -> float:
        return float(self.delta[-1])


def read(path: Path) -> PadTables:
    """Read a table file. Raises UserError where it is unreadable or its hash does not fit."""
    remedy = "make it again with `tactibench sim tabulate --planar` or reinstall tactibench."
    return sealed.read(path, "the planar sensor's table", remedy, _tables)


def _tables(arrays: sealed.Arrays, parameters: dict[str, Any], digest: str) -> PadTables:
    known = {name: arrays[name].astype(np.float64) for name in ("radii", "delta", "r")}
    fields = {name: arrays[name].astype(np.float64) for name in QUANTITIES}
    return PadTables(parameters, digest, **known, fields=fields)


@cache
def shipped() -> PadTables:
    """The tables that ship with the package."""
    with as_file(files("tactibench_sim").joinpath(FILE)) as path:
        return read(path)
