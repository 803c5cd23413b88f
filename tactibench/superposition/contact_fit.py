"""The fit of contacts to one frame: pins that may be mistaken, and an image that may have moved.

How many contacts there are, and about where, is the matter of a ``search``: a greedy one looks for
them (model ``superpose``), a refinement is given them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactibench.markers import AlignedPins, Similarity
from tactibench.superposition.field import Field, Solution, cost_of, solve

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]

STEPS = 8
"""Steps of a fit while contacts are looked for; the last solution is then fitted further."""
FINISH = 12
"""Steps of the last fit."""
_DOUBT = 0.04
"""Weight of a doubtful pin while contacts are looked for: most doubtful pins around a crowd are
where they should be, and without them nothing would tell what presses there."""
_OWN = 0.35
"""A doubtful pin takes the nearest seen place if that is within this share of the pins' spacing of
where the contacts put the pin."""
_ROUNDS, _KEPT, _NEAR = 4, 0.22, 0.5
"""Rounds in which crowded pins are tracked again. A pin nearer than _KEPT spacings to where it is
expected starts from where it was; one that ends farther off than _NEAR spacings stays doubtful."""
_MOTIONS = (2.0, 2.0, 0.05, 0.005)
"""Standard deviations of the image's motion: px along x and y, rad and logarithm of the size. A
camera that was remounted moves this far; beyond it, pins are mistaken for others anyway."""
_MOTION_GAIN = 1.6
"""Factor by which a motion of the image must lower the misfit: with a camera that had not moved,
single presses reached at most 1.09 and pairs, whose law is not exact, 1.3."""
_SUSPECT = 1.1
"""Such a factor from which a frame is searched once more with a motion."""
_MOTION_ROUNDS, _MOTION_STEPS = 2, 2
"""Rounds in which a motion is looked for and removed, and steps of the trial whether there is
one."""


@dataclass(frozen=True, eq=False)
class Found:
    """The contacts of a frame, and the displacements in which they were found.

    Attributes:
        solution: The contacts of the one frame, their nuisances, and the misfit.
        share: (K,) shares of the misfit that each contact explains.
        moved: (Q,) displacements, px.
        weight: (Q,) 1 / variance, 1 / px^2; 0 for pins that were not sure.
        cost: The misfit, chi^2, and the nuisances' part (``cost_of``).
    """

    solution: Solution
    share: Array
    moved: Array
    weight: Array
    cost: float

    @property
    def explained(self) -> float:
        """Return the share of all displacements that the contacts explain together.

        Displacements are summed by their size, not its square: a few pins that are mistaken for
        others count little in it.
        """
        noise = np.sqrt(self.weight)
        total = float((noise * np.abs(self.moved)).sum())
        left = float((noise * np.abs(self.solution.left[0])).sum())
        return 1 - left / total if total > 0 else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactFit(ABC):
    """A fit of contacts to one frame.

    Attributes:
        field: Field of one contact.
        pins: The pins of the sensor.
        weight: (Q,) 1 / variance of the displacements, 1 / px^2.
        gain: Factor by which a further contact must lower the misfit.
        motions: (R, Q) displacements by each motion of the image that is looked for, px.
    """

    field: Field
    pins: AlignedPins
    weight: Array
    gain: float
    motions: Array

    @abstractmethod
    def search(self, image: Image, moved: Array, sure: Flags) -> Found:
        """Return the contacts of one frame, whose image may move by ``motions`` only."""

    def find(self, image: Image, moved: Array, sure: Flags) -> Found:
        """Return the contacts of one frame.

        Where a motion of the image explains part of the misfit, it is fitted with them.

        Args:
            image: (H, W) gray.
            moved: (Q,) displacements, px, as ``AlignedPins.track`` returns them.
            sure: (P,) whether a pin is surely itself, likewise.
        """
        still = self.search(image, moved, sure)
        tried = replace(self, motions=_motions_of(self.pins.rest))
        trial = tried.solve(still.moved, still.solution.contacts, still.weight, _MOTION_STEPS)
        if still.cost < _SUSPECT * self.cost(trial, still.weight):
            return still
        for _ in range(_MOTION_ROUNDS):
            with_motion = tried.search(image, moved, sure)
            motion = tried._motion(with_motion.solution)
            places = tried.pins.rest + moved.reshape(2, -1).T
            moved = (motion.back(places) - tried.pins.rest).T.reshape(-1)
            tried = replace(tried, pins=tried.pins.moved(motion))
        # Without the motion, further contacts may have stood for it: each must be worth its gain.
        more = len(still.share) - len(with_motion.share)
        worth = _MOTION_GAIN if more <= 0 else 1.0
        return with_motion if with_motion.cost * worth < still.cost * self.gain**more else still

    def trusted(self, sure: Flags) -> Array:
        """Return the (Q,) weights while contacts are looked for: doubtful pins count a little."""
        weight: Array = self.weight * np.tile(np.where(sure, 1.0, _DOUBT), 2)
        return weight

    def finish(self, moved: Array, contacts: Array, weight: Array) -> Found:
        """Return the last fit of (1, K, 3) contacts, mm."""
        solution = self.solve(moved, contacts, weight, FINISH)
        without = solution.left + self.own(solution)
        left, total = (weight * solution.left**2).sum(), (weight * without**2).sum(axis=1)
        share = np.zeros_like(total)  # where no pin is sure, a contact explains nothing
        share[total > 0] = 1 - left / total[total > 0]
        return Found(solution, share, moved, weight, self.cost(solution, weight))

    def solve(self, moved: Array, start: Array, weight: Array, steps: int = STEPS) -> Solution:
        """Return the fit of (S, K, 3) contacts, mm, to displacements (Q,), px."""
        return solve(self.field, moved[None], start, weight, steps, motions=self.motions)

    def cost(self, solution: Solution, weight: Array) -> float:
        """Return the misfit and the nuisances' part (``cost_of``)."""
        motions = solution.nuisances.shape[1] - self.field.ways
        held = self.field.correlated(solution.contacts.shape[1], motions)
        return cost_of(solution, weight, held)

    def own(self, solution: Solution) -> Array:
        """Return the (K, Q) displacements by every contact of the one frame, px."""
        return self.field(solution.contacts[0], solution.nuisances[0, : self.field.ways])

    def expected(self, solution: Solution) -> Array:
        """Return the (Q,) displacements by contacts and the image's motion together, px."""
        moving = solution.nuisances[0, self.field.ways :]
        expected: Array = self.own(solution).sum(axis=0) + moving @ self.motions
        return expected

    def retrack(
        self, image: Image, moved: Array, sure: Flags, best: Solution
    ) -> tuple[Array, Flags, Solution]:
        """Track pins again from where the contacts put them.

        This is repeated, because better contacts put the pins of a crowd better.

        Returns:
            (Q,) displacements, px; (P,) whether a pin is sure; and the contacts.
        """
        for turn in range(_ROUNDS):
            expected = self.expected(best)
            near = sure if turn == 0 else self._distance(moved, expected) < _KEPT
            start = np.where(np.tile(near, 2), moved, expected)
            again, seen = self.pins.retrack(image[None], start[None])
            if not seen.any():  # pins without a profile can only take places that were seen
                moved, sure = self._assign_seen(moved, sure, expected)
            else:
                moved, sure = again[0], seen[0] & (self._distance(again[0], expected) < _NEAR)
            best = self.solve(moved, best.contacts, self.weight * np.tile(sure, 2))
            if not seen.any():
                break
        return moved, sure, best

    def _motion(self, solution: Solution) -> Similarity:
        """Return the motion of the image that was fitted with the contacts."""
        x, y, turn, stretch = solution.nuisances[0, self.field.ways :] * _MOTIONS
        return Similarity.of(np.array([x, y]), turn, stretch, self.pins.rest.mean(axis=0))

    def _distance(self, moved: Array, expected: Array) -> Array:
        """Return the (P,) distances of pins from their expected places, in spacings."""
        distance: Array = np.hypot(*(moved - expected).reshape(2, -1)) / self.pins.pitch
        return distance

    def _assign_seen(self, moved: Array, sure: Flags, expected: Array) -> tuple[Array, Flags]:
        """Assign to doubtful pins the seen places near to where the contacts put them."""
        seen = self.pins.rest + moved.reshape(2, -1).T
        wanted = self.pins.rest + expected.reshape(2, -1).T
        doubtful = np.flatnonzero(~sure)
        apart = np.hypot(*(wanted[doubtful, None] - seen).transpose(2, 0, 1))
        nearest = apart.argmin(axis=1)
        near = apart[np.arange(len(doubtful)), nearest] < _OWN * self.pins.pitch
        assigned, assured = moved.reshape(2, -1).copy(), sure.copy()
        assigned[:, doubtful[near]] = (seen[nearest[near]] - self.pins.rest[doubtful[near]]).T
        assured[doubtful[near]] = True
        return assigned.reshape(-1), assured


def _motions_of(rest: Array) -> Array:
    """Return (4, Q) displacements, px, of pins (P, 2) by image motions of one deviation each."""
    x, y = (rest - rest.mean(axis=0)).T
    ones, zeros = np.ones_like(x), np.zeros_like(x)
    ways = [(ones, zeros), (zeros, ones), (-y, x), (x, y)]
    return np.stack([size * np.concatenate(way) for size, way in zip(_MOTIONS, ways, strict=True)])
