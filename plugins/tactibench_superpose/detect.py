"""Detection of contacts by greedy insertion; after each insertion all are refined together.

The error of superposed fields of single presses for several contacts, by its covariance.

Contacts shift and weaken each other, so that superposed fields leave a residual far beyond the
camera's noise. It is similar from press to press. Measured by its covariance, a further contact
that only explains the usual residual is worth nothing, and a faint one that is really there is
worth much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.markers import AlignedPins
from tactibench.superposition import FINISH, STEPS, ContactFit, Field, Found, Solution, solve

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

FEWEST = 300
"""Least number of presses with several contacts from which a covariance is learned."""


@dataclass(frozen=True, eq=False)
class ModelError:
    """The usual residual of presses with several contacts.

    Attributes:
        covariance: (Q, Q) covariance, in standard deviations of the noise; (0, 0): unknown.
        scale: (Q,) factors from px to standard deviations of the noise.
    """

    covariance: Array
    scale: Array

    @classmethod
    def unknown(cls, weight: Array) -> Self:
        """Return a model error whose covariance is unknown.

        Args:
            weight: (Q,) 1 / variance of the noise, 1 / px^2.
        """
        return cls(np.empty((0, 0)), np.sqrt(weight))

    @classmethod
    def learn(cls, left: Array, weight: Array) -> Self:
        """Learn the covariance from residuals of presses explained by their true contacts.

        In no direction is the variance taken to be less than that of the noise. With fewer than
        FEWEST residuals the covariance stays unknown.

        Args:
            left: (N, Q) residuals, px.
            weight: (Q,) 1 / variance of the noise, 1 / px^2.
        """
        if len(left) < FEWEST:
            return cls.unknown(weight)
        scaled = left * np.sqrt(weight)
        variances, axes = np.linalg.eigh(scaled.T @ scaled / len(scaled))
        return cls((axes * np.maximum(variances, 1.0)) @ axes.T, np.sqrt(weight))

    @property
    def learned(self) -> bool:
        """True if there were enough presses to learn from."""
        return bool(self.covariance.size)

    def whitener(self, sure: Flags) -> Array:
        """Return the (Q, M) matrix that whitens residuals of the sure pins.

        It makes them independent, of variance 1. M is twice the number of these pins.

        Args:
            sure: (P,) whether a pin is sure.
        """
        return (
            self._whitener_of_all
            if sure.all()
            else self._whitener_of(np.flatnonzero(np.tile(sure, 2)))
        )

    @cached_property
    def _whitener_of_all(self) -> Array:
        return self._whitener_of(np.arange(len(self.scale)))

    def _whitener_of(self, rows: npt.NDArray[np.intp]) -> Array:
        lower = np.linalg.cholesky(self.covariance[np.ix_(rows, rows)])
        whitener = np.zeros((len(self.scale), len(rows)))
        whitener[rows] = self.scale[rows, None] * np.linalg.inv(lower).T
        return whitener


Image = npt.NDArray[np.uint8]

_PITCH_MM = 0.8
"""Pitch of the lattice on which contacts are first looked for, before refinement."""
_DEPTHS_MM = (0.3, 0.6, 1.2, 2.4, 4.2)
"""Depths of that lattice, each about twice the one before."""
SHALLOWEST_MM = (0.15, 0.35)
"""Depths below which a fit is no contact: alone, and beside others, whose misfit it may explain."""
FIRM = 0.3
"""Share of the misfit from which the contact that explains it is surely there: of training pairs
with a third contact too many, that one explained less in 99 of 100. Fainter contacts, which may not
be there, are reported but do not shift the firm ones."""
CLOSEST_MM = 4.0
"""Two fits closer than this are one."""
_WORTH = 0.1
"""A further contact is tried where one on the lattice gains this share of what it must gain."""
_STARTS = 2
_APART_MM = 2.5
"""Number of places from which a further contact is looked for, and their least distance."""
_SURER = 1.12
"""Factor by which a third or further contact must lower the misfit that is not usual. Of training
presses that were held out, 231 with a contact too many reached 1.07, and 99 of 100 of those with
the right ones exceeded 1.23."""
_CROWD = 1.1
"""Factor on the gain of a third or further contact: of 150 simulated training pairs, four got a
third one with a gain of 1.2 and none with 1.3; as many triples were complete."""
_NOISE = 8.0
"""chi^2 per displacement below which no further contact is looked for; a doubtful displacement
counts less."""
_TURNS, _ASIDE_MM, _SHARE = 6, 3.5, 0.75
"""A contact is split in this many directions, to this distance on either side, at this share of its
depth."""
_FIRST = 50.0
"""chi^2 below which no misfit is worth a contact, however large its share."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Detector(ContactFit):
    """A search for the contacts of a frame.

    Attributes:
        most: Most contacts of a frame.
        places: (M, 3) contacts on a lattice, mm.
        shapes: (M, Q) displacements by these contacts, px.
        squares: (M, Q) squares of ``shapes``, px^2.
        model_error: The usual residual of several contacts.
    """

    most: int
    places: Array
    shapes: npt.NDArray[np.float32]
    squares: npt.NDArray[np.float32]
    model_error: ModelError

    @classmethod
    def of(cls, field: Field, pins: AlignedPins, weight: Array, gain: float, most: int) -> Self:
        """Return a detector, with the fields of contacts on a lattice over the range of the field.

        The arguments are attributes of the class.
        """
        low, high = field.low, field.high
        sides = [np.arange(a, b + 1e-9, _PITCH_MM) for a, b in zip(low[:2], high[:2], strict=True)]
        depths = np.array([d for d in _DEPTHS_MM if d < high[2]])
        places = np.stack(np.meshgrid(*sides, depths, indexing="ij"), axis=-1).reshape(-1, 3)
        shapes = field(places).astype(np.float32)
        return cls(
            field=field,
            pins=pins,
            weight=weight,
            gain=gain,
            motions=np.empty((0, len(weight))),
            most=most,
            places=places,
            shapes=shapes,
            squares=shapes**2,
            model_error=ModelError.unknown(weight),
        )

    def search(self, image: Image, moved: Array, sure: Flags) -> Found:
        """Return the contacts of one frame, whose image may move by ``motions`` only.

        Doubtful pins wait until contacts are found, which then predict where each pin is.
        """
        weight = self.trusted(sure)
        best = self._insert(moved, weight, self._nothing(moved, weight))
        if best.contacts.size and not sure.all():
            moved, sure, _ = self.retrack(image, moved, sure, self._likeliest(moved, sure, best))
            weight = self.weight * np.tile(sure, 2)
            # From nothing: a contact may have been put where pins were mistaken for others.
            best = self._insert(moved, weight, self._nothing(moved, weight))
        if not best.contacts.size:
            return Found(best, np.empty(0), moved, weight, self.cost(best, weight))
        return self.finish(moved, best.contacts, weight)

    def _nothing(self, moved: Array, weight: Array) -> Solution:
        """Return the solution without contacts: only the image moves, if it may."""
        return self.solve(moved, np.zeros((1, 0, 3)), weight)

    def explain(self, images: Image, contacts: Array) -> tuple[Array, Array]:
        """Return the equivalents of true contacts in their frames, and the residuals.

        Args:
            images: (S, H, W) gray.
            contacts: (S, K, 3) true contacts, mm.

        Returns:
            (S, K, 3) equivalents, mm, and (C, Q) residuals, px, of frames whose pins were all sure.
        """
        moved, sure = self.pins.track(images)
        weight = self.weight * np.tile(sure, (1, 2))
        best = solve(self.field, moved, contacts, weight, FINISH)
        equivalents, clear = best.contacts, sure.all(axis=1)
        for row in np.flatnonzero(~clear):
            span = slice(row, row + 1)
            start = Solution(
                equivalents[span], best.left[span], best.normal[span], best.nuisances[span]
            )
            _, _, end = self.retrack(images[row], moved[row], sure[row], start)
            equivalents[row] = end.contacts[0]
        return equivalents, best.left[clear]

    def _insert(self, moved: Array, weight: Array, best: Solution) -> Solution:
        """Return the solution with as many contacts as are worth their gain."""
        while best.contacts.shape[1] < self.most:
            more = self._add_contact(moved, weight, best)
            if more is None:
                break
            best = more
        return best

    def _surer(self, moved: Array, weight: Array, current: Solution, more: Solution) -> bool:
        """Return whether more contacts also lower the misfit that is not usual by enough."""
        if not self.model_error.learned or current.contacts.shape[1] < 2:
            return True
        sure = (weight >= self.weight)[: len(weight) // 2]
        before, after = (self._solve_whitened(moved, sure, start)[2] for start in (current, more))
        return before >= _SURER * after

    def _likeliest(self, moved: Array, sure: Flags, best: Solution) -> Solution:
        """Return several contacts where the sure pins put them, given the usual residual.

        Where pins of a crowd are missing, plain least squares puts deep contacts up to 3 mm off.
        """
        if not self.model_error.learned or best.contacts.shape[1] < 2:
            return best
        contacts, nuisances, _ = self._solve_whitened(moved, sure, best)
        likeliest = replace(best, contacts=contacts, nuisances=nuisances)
        return replace(likeliest, left=moved[None] - self.expected(likeliest))

    def _solve_whitened(
        self, moved: Array, sure: Flags, start: Solution
    ) -> tuple[Array, Array, float]:
        """Return (1, K, 3) contacts and nuisances of the least unusual residual, and its chi^2."""
        whitener = self.model_error.whitener(sure)
        ones = np.ones(whitener.shape[1])
        solution = solve(
            self.field, moved[None], start.contacts, ones, STEPS, whitener, self.motions
        )
        return solution.contacts, solution.nuisances, self.cost(solution, ones)

    def _add_contact(self, moved: Array, weight: Array, current: Solution) -> Solution | None:
        """Return the best solution with a new contact, else with one split in two, else None."""
        cost = self.cost(current, weight)
        if cost < _NOISE * (weight / self.weight).sum():
            return None
        worth = _WORTH * (1 - 1 / self.gain) * cost
        for starts in (self._new(weight, current, worth), self._splits(weight, current)):
            ends = [self.solve(moved, start, weight) for start in starts]
            accepted = self._accept(ends, moved, weight, current)
            if accepted is not None:
                return accepted
        return None

    def _new(self, weight: Array, current: Solution, worth: float) -> Iterator[Array]:
        """Yield the contacts with a further one, from the places that gain most."""
        for candidate in self._candidates(current, weight, worth):
            yield np.concatenate([current.contacts, candidate], axis=1)

    def _splits(self, weight: Array, current: Solution) -> Iterator[Array]:
        """Yield the contacts with each one split in two, in the direction that lowers misfit most.

        Two contacts that were taken for one lie on either side of it, too near to be found as new.
        """
        displaced, z = self.own(current), current.nuisances[0, : self.field.ways]
        for k in range(current.contacts.shape[1]):
            others = np.delete(current.contacts[0], k, axis=0)
            x, y, depth = current.contacts[0, k]
            turned = [np.pi * turn / _TURNS for turn in range(_TURNS)]
            pairs = np.array(
                [
                    [
                        [x + side * np.cos(a), y + side * np.sin(a), _SHARE * depth]
                        for side in (-_ASIDE_MM, _ASIDE_MM)
                    ]
                    for a in turned
                ]
            )
            left = current.left[0] + displaced[k] - self.field(pairs, z).sum(axis=1)
            best = int(np.argmin((weight * left**2).sum(axis=1)))
            yield np.concatenate([others, pairs[best]])[None]

    def _accept(
        self, ends: list[Solution], moved: Array, weight: Array, current: Solution
    ) -> Solution | None:
        """Return the plausible solution of least misfit, or None if it is not enough better."""
        cost = self.cost(current, weight)
        gain = self.gain * (_CROWD if current.contacts.shape[1] > 1 else 1.0)
        for end in sorted(ends, key=lambda end: self.cost(end, weight)):
            if cost < max(gain * self.cost(end, weight), _FIRST):
                return None
            if self._plausible(end.contacts[0]) and self._surer(moved, weight, current, end):
                return end
        return None

    def _candidates(self, current: Solution, weight: Array, worth: float) -> list[Array]:
        """Return lattice contacts (1, 1, 3) that lower the misfit most, apart from each other."""
        left = (weight * current.left[0]).astype(np.float32)
        gained = 2 * (self.shapes @ left) - self.squares @ weight.astype(np.float32)
        for contact in current.contacts[0]:
            gained[np.hypot(*(self.places[:, :2] - contact[:2]).T) < CLOSEST_MM] = -np.inf
        candidates: list[Array] = []
        while len(candidates) < (_STARTS if len(current.contacts[0]) else 1):
            best = int(np.argmax(gained))
            if gained[best] < worth:
                break
            place = self.places[best]
            candidates.append(place[None, None])
            gained[np.hypot(*(self.places[:, :2] - place[:2]).T) < _APART_MM] = -np.inf
        return candidates

    def _plausible(self, contacts: Array) -> bool:
        if (contacts[:, 2] < SHALLOWEST_MM[len(contacts) > 1]).any():
            return False
        apart = np.hypot(*(contacts[:, None, :2] - contacts[None, :, :2]).transpose(2, 0, 1))
        return not (apart[np.triu_indices(len(contacts), 1)] < CLOSEST_MM).any()
