"""The corrections of a table file for the rim and for pairs of contacts, ready for look-up.

A correction is a *patch*: a small field around a middle direction m, given in the frame (e, f, m),
where e points down the dome's side or from one contact to the other and the plane of e and m is a
mirror plane. Positions are Lambert's equal-area coordinates: a point at the angle r from m in the
direction (cos, sin) of the tangent plane lies at 2 sin(r / 2) (cos, sin). Vectors are kept by their
components along e, f, m, so nothing is singular at the middle. A patch is a linear combination of a
few fixed modes: the amounts are cubic splines of the contact's parameters, the modes cubic splines
of the position, so that everything is twice continuously differentiable and ends smoothly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim.mechanics.kernels import Around, Modes, Pairs

Array = npt.NDArray[np.float64]
SIX = 6  # displacement and turn of the normal, along three axes


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

    arrays: Mapping[str, Array] = field(default_factory=dict)
    grid: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_arrays(
        cls, content: Mapping[str, npt.NDArray[Any]], grid: dict[str, Any] | None
    ) -> Corrections:
        """Take the corrections among the arrays of a file; none where ``grid`` is None."""
        if grid is None:
            return cls()
        names = [name for name in content if name.startswith(("around_", "pair_"))]
        return cls({name: content[name].astype(np.float64) for name in names}, grid)

    def without_plates(self) -> Corrections:
        """Return the corrections without O for plates, as they are for plates that hold the skin.

        Most of that O is a sway. A tilted plate without friction lets the whole dome slide sideways
        by up to 0.3 mm; a plate that the skin sticks to does not.
        """
        if "around_radii" not in self.grid:
            return self
        radii = [math.nan if radius is None else radius for radius in self.grid["around_radii"]]
        return replace(self, grid={**self.grid, "around_radii": radii})

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
