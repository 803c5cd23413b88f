"""How many contacts, and roughly where: greedy insertion, every time with all refined together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition import Eye, Field, Solution, solve

Array = npt.NDArray[np.float64]

_PITCH_MM = 0.8
_DEPTHS_MM = (0.6, 1.2, 2.4, 4.2)
_STEPS = 8
"""Steps of refinement after each insertion; the last solution is then finished."""
_FINISH = 12
_OWN = 0.35
"""A doubtful pin's place is the one that was seen within this share of the pins' spacing of where
the contacts put it."""
SHALLOWEST_MM = (0.15, 0.35)
"""A fit shallower than this is no contact: alone, and beside others, whose misfit it may take."""
CLOSEST_MM = 4.0
"""Two fits closer than this are one."""
_WORTH = 0.1
"""A further contact is tried where one on the lattice gains this share of what it must gain."""
_STARTS = 2
_APART_MM = 2.5
"""From so many places, so far apart, is a further contact looked for."""
_NOISE = 8.0
"""chi^2 by degree of freedom below which nothing more is looked for."""
_TURNS, _ASIDE_MM, _SHARE = 6, 3.5, 0.75
"""A contact is parted in so many directions, so far to either side, at this share of its depth."""
_FIRST = 50.0
"""chi^2 below which no misfit is worth a contact, however large its share."""


@dataclass(frozen=True, eq=False)
class Detector:
    """field: of what one contact does to the pins of ``eye``. weight: (Q,) 1 / variance.

    gain, most: as declared. places: contacts on a lattice, with their shapes and energies.
    """

    field: Field
    eye: Eye
    weight: Array
    gain: float
    most: int
    places: Array
    shapes: npt.NDArray[np.float32]
    energy: Array

    @classmethod
    def of(cls, field: Field, eye: Eye, weight: Array, gain: float, most: int) -> Self:
        """Fields of contacts on a lattice over the workspace are computed once."""
        low, high = field.low, field.low + field.step * (np.array(field.coefficients.shape[:3]) - 1)
        sides = [np.arange(a, b + 1e-9, _PITCH_MM) for a, b in zip(low[:2], high[:2], strict=True)]
        depths = np.array([d for d in _DEPTHS_MM if d < high[2]])
        places = np.stack(np.meshgrid(*sides, depths, indexing="ij"), axis=-1).reshape(-1, 3)
        shapes = field(places)
        energy = (weight * shapes**2).sum(axis=1)
        return cls(field, eye, weight, gain, most, places, shapes.astype(np.float32), energy)

    def find(self, moved: Array, sure: npt.NDArray[np.bool_]) -> tuple[Solution, Array]:
        """The contacts of one frame, and (K,) the share of the misfit that each one takes away.

        moved: (Q,) px, sure: (P,), as ``Eye.watch`` gives them. Doubtful pins wait until the
        contacts are found, which then say which place is theirs.
        """
        weight = self.weight * np.tile(sure, 2)
        best = Solution(np.zeros((1, 0, 3)), moved[None].copy(), np.zeros((1, 0, 0)))
        while best.contacts.shape[1] < self.most:
            more = self._with_more(moved, weight, best)
            if more is None:
                break
            best = more
        if not best.contacts.size:
            return best, np.empty(0)
        if not sure.all():
            moved, sure = self._named(moved, sure, best.left[0])
            weight = self.weight * np.tile(sure, 2)
        found = solve(self.field, moved[None], best.contacts, weight, _FINISH)
        without = found.left + self.field(found.contacts[0])
        return found, 1 - _cost(found, weight) / (weight * without**2).sum(axis=1)

    def _with_more(self, moved: Array, weight: Array, known: Solution) -> Solution | None:
        """The best solution with one contact more: a new one or, failing that, one split in two."""
        cost = _cost(known, weight)
        if cost < _NOISE * np.count_nonzero(weight):
            return None
        worth = _WORTH * (1 - 1 / self.gain) * cost
        new = [
            np.concatenate([known.contacts, candidate], axis=1)
            for candidate in self._candidates(known, weight, worth)
        ]
        for starts in (new, self._splits(moved, weight, known)):
            ends = [solve(self.field, moved[None], start, weight, _STEPS) for start in starts]
            found = self._accepted(ends, weight, cost)
            if found is not None:
                return found
        return None

    def _splits(self, moved: Array, weight: Array, known: Solution) -> list[Array]:
        """Every contact parted into two, in the direction that lowers the misfit most.

        Two contacts that were taken for one lie on either side of it, too near to be found as new.
        """
        starts = []
        for k in range(known.contacts.shape[1]):
            others = np.delete(known.contacts[0], k, axis=0)
            x, y, depth = known.contacts[0, k]
            turned = [np.pi * turn / _TURNS for turn in range(_TURNS)]
            pairs = np.array([
                [[x + side * np.cos(a), y + side * np.sin(a), _SHARE * depth]
                 for side in (-_ASIDE_MM, _ASIDE_MM)]
                for a in turned
            ])  # fmt: skip
            left = moved - self.field(others).sum(axis=0) - self.field(pairs).sum(axis=1)
            best = int(np.argmin((weight * left**2).sum(axis=1)))
            starts.append(np.concatenate([others, pairs[best]])[None])
        return starts

    def _accepted(self, ends: list[Solution], weight: Array, cost: float) -> Solution | None:
        """The plausible solution of least misfit, if that is lower by the factor ``gain``."""
        plausible = [end for end in ends if self._plausible(end.contacts[0])]
        if not plausible:
            return None
        best = min(plausible, key=lambda end: _cost(end, weight))
        return best if cost >= max(self.gain * _cost(best, weight), _FIRST) else None

    def _named(
        self, moved: Array, sure: npt.NDArray[np.bool_], left: Array
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Doubtful pins at the seen places nearest to where the contacts put them, where near."""
        seen = self.eye.rest + moved.reshape(2, -1).T
        expected = seen - left.reshape(2, -1).T
        doubtful = np.flatnonzero(~sure)
        apart = np.hypot(*(expected[doubtful, None] - seen).transpose(2, 0, 1))
        nearest = apart.argmin(axis=1)
        near = apart[np.arange(len(doubtful)), nearest] < _OWN * self.eye.pitch
        named, known = moved.reshape(2, -1).copy(), sure.copy()
        named[:, doubtful[near]] = (seen[nearest[near]] - self.eye.rest[doubtful[near]]).T
        known[doubtful[near]] = True
        return named.reshape(-1), known

    def _candidates(self, known: Solution, weight: Array, worth: float) -> list[Array]:
        """Lattice contacts (1, 1, 3) that lower the misfit most, apart from each other."""
        gained = 2 * (self.shapes @ (weight * known.left[0]).astype(np.float32)) - self.energy
        for contact in known.contacts[0]:
            gained[np.hypot(*(self.places[:, :2] - contact[:2]).T) < CLOSEST_MM] = -np.inf
        found: list[Array] = []
        while len(found) < (_STARTS if len(known.contacts[0]) else 1):
            best = int(np.argmax(gained))
            if gained[best] < worth:
                break
            place = self.places[best]
            found.append(place[None, None])
            gained[np.hypot(*(self.places[:, :2] - place[:2]).T) < _APART_MM] = -np.inf
        return found

    def _plausible(self, contacts: Array) -> bool:
        if (contacts[:, 2] < SHALLOWEST_MM[len(contacts) > 1]).any():
            return False
        apart = np.hypot(*(contacts[:, None, :2] - contacts[None, :, :2]).transpose(2, 0, 1))
        return not (apart[np.triu_indices(len(contacts), 1)] < CLOSEST_MM).any()


def _cost(solution: Solution, weight: Array) -> float:
    return float((weight * solution.left[0] ** 2).sum())
