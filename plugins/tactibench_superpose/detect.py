"""How many contacts, and roughly where: greedy insertion, every time with all refined together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition import Field, Solution, solve

Array = npt.NDArray[np.float64]

_PITCH_MM = 0.8
_DEPTHS_MM = (0.6, 1.2, 2.4, 4.2)
_STEPS = 8
"""Steps of refinement after each insertion; the last solution is then finished."""
_FINISH = 12
SHALLOWEST_MM = 0.15
"""A fit shallower than this is no contact."""
CLOSEST_MM = 4.0
"""Two fits closer than this are one."""
_WORTH = 0.1
"""A further contact is tried where one on the lattice gains this share of what it must gain."""
_FIRST = 50.0
"""chi^2 by which the first contact must explain a frame."""


@dataclass(frozen=True, eq=False)
class Detector:
    """field: of single presses. weight: (Q,) 1 / variance. gain, most: as declared."""

    field: Field
    weight: Array
    gain: float
    most: int
    places: Array
    shapes: npt.NDArray[np.float32]
    energy: Array

    @classmethod
    def of(cls, field: Field, weight: Array, gain: float, most: int) -> Self:
        """Fields of contacts on a lattice over the workspace are computed once."""
        low, high = field.low, field.low + field.step * (np.array(field.coefficients.shape[:3]) - 1)
        sides = [np.arange(a, b + 1e-9, _PITCH_MM) for a, b in zip(low[:2], high[:2], strict=True)]
        depths = np.array([d for d in _DEPTHS_MM if d < high[2]])
        places = np.stack(np.meshgrid(*sides, depths, indexing="ij"), axis=-1).reshape(-1, 3)
        shapes = field(places)
        energy = (weight * shapes**2).sum(axis=1)
        return cls(field, weight, gain, most, places, shapes.astype(np.float32), energy)

    def find(self, moved: Array) -> tuple[Solution, Array]:
        """The contacts of one frame (Q,), and (K,) the share of the misfit each one took."""
        none = np.zeros((1, 0, 3))
        best = Solution(none, moved[None].copy(), np.zeros((1, 0, 0)))
        taken: list[float] = []
        cost = self._cost(best)
        while len(taken) < self.most:
            candidate, gained = self._candidate(best.left[0])
            if gained < _WORTH * (1 - 1 / self.gain) * cost:
                break
            start = np.concatenate([best.contacts, candidate], axis=1)
            tried = solve(self.field, moved[None], start, self.weight, _STEPS)
            now = self._cost(tried)
            if not self._plausible(tried.contacts[0]) or cost < max(self.gain * now, _FIRST):
                break
            best, share, cost = tried, 1 - now / cost, now
            taken.append(share)
        if taken:
            best = solve(self.field, moved[None], best.contacts, self.weight, _FINISH)
        return best, np.array(taken)

    def _cost(self, solution: Solution) -> float:
        return float((self.weight * solution.left[0] ** 2).sum())

    def _candidate(self, left: Array) -> tuple[Array, float]:
        """(1, 1, 3): the lattice contact that lowers the misfit most, and by how much."""
        gained = 2 * (self.shapes @ (self.weight * left).astype(np.float32)) - self.energy
        first = int(np.argmax(gained))
        return self.places[None, None, first], float(gained[first])

    def _plausible(self, contacts: Array) -> bool:
        if (contacts[:, 2] < SHALLOWEST_MM).any():
            return False
        apart = np.hypot(*(contacts[:, None, :2] - contacts[None, :, :2]).transpose(2, 0, 1))
        return not (apart[np.triu_indices(len(contacts), 1)] < CLOSEST_MM).any()
