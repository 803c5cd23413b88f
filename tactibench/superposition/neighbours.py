"""The law of neighbouring contacts: each acts like a single contact at another place and depth.

The pins' displacements of a press are close to a sum of single-press fields if contact i is
replaced by its *equivalent* e_i: a neighbour j has lowered the skin under it, so it carries less
(load sharing), and the skin between the two is drawn down, so it acts nearer to j:

    e_i = c_i + sum_{j != i} [s(i, j) towards_ij + p(i, j) beside_ij, h(i, j)]

s, p and h are polynomials of the distance, both depths and the place of the pair on the dome. In a
crowd a third contact takes load off both, which is included to first order.

The shipped coefficients were fitted to finite-element mechanics of a nominal dome (radius 20 mm,
two and three tips of radius 3 mm at random places; benchmarks/neighbours.py computes them again).
Tips that rub drag the skin under each other. So there are coefficients for a friction of 0, 0.25,
0.5 and 1, between which a law is linear in how far the skin follows single tips (``drag_clue``):
that is read from the field, and friction is not told. They contain lengths only: no camera, no pins
and no frames. ``NeighbourLaw.learn`` fits them to labelled presses instead.

The residual of the law of ``neighbours`` for two contacts, learned from pairs.

The law is a polynomial; its residual is smooth, small and the same for pairs with the same
features. It is kriged over these five features, in the frame of the pair. A mirrored pair has the
mirrored residual, so along the pair and in depth the kernel is even in the place beside the pair,
and across the pair it is odd.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from itertools import combinations_with_replacement, pairwise
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition.field import kriging, matern

Array = npt.NDArray[np.float64]

LENGTHS = (1.5, 2.0, 3.0)
"""Lengths of the kernel that are tried, in the features' scales."""
RIDGES = (3e-3, 1e-2, 3e-2, 1e-1)
"""Variances of noise relative to that of the residual that are tried."""
FEWEST = 100
"""Fewest pairs from which a residual is learned; with fewer it is zero."""
_MIRROR = np.array([1.0, 1.0, 1.0, 1.0, -1.0])
"""Signs of the features when a pair is mirrored at the line through both contacts."""
_ALONG, _ACROSS = [0, 2], [1]
"""Components of a shift in which the kernel is even, and in which it is odd."""
_HELD_OUT = 10
"""One pair in this many is held out to choose length and ridge."""
_FAR = 0.7
"""Distance from every training pair, in scales, beyond which the residual is held to zero."""
_HELD = 600
"""Approximate number of places at which the residual is held to zero."""
_OUTLIER = 6.0
"""Robust standard deviations beyond which the residual of a pair comes from a wrong detection."""


@dataclass(frozen=True, eq=False)
class Residual:
    """A kriged shift of two contacts.

    Attributes:
        features: (N, 5) features of the training.
        along: (N, 2) weights towards the neighbour and in depth.
        across: (N, 1) weights across the pair.
        length: Length of the kernel, in the features' scales.
    """

    features: Array
    along: Array
    across: Array
    length: float

    @classmethod
    def none(cls) -> Self:
        """Return the residual that is zero."""
        return cls(np.empty((0, 5)), np.empty((0, 2)), np.empty((0, 1)), LENGTHS[0])

    @classmethod
    def learn(cls, contacts: Array, left: Array) -> Self:
        """Learn the residual from pairs.

        Length and ridge are those that predict every tenth pair best. For pairs unlike all of the
        training, such as uneven pairs after level ones, the residual is zero.

        Args:
            contacts: (S, 2, 3) equivalents of pairs, mm.
            left: (S, 2, 3) their residual shifts, mm.
        """
        size = np.maximum(1.4826 * np.median(np.abs(left), axis=(0, 1)), 1e-6)
        usual = (np.abs(left) < _OUTLIER * size).all(axis=(1, 2))
        if np.count_nonzero(usual) < FEWEST:
            return cls.none()
        features, wanted = _samples(contacts[usual], left[usual])
        held = np.arange(features.shape[1]) % _HELD_OUT == 0
        far = _far_from(_flat(features), contacts[usual])
        nothing = np.zeros((len(far), 3))
        learned = np.concatenate([_flat(features[:, ~held]), far])
        shifts = np.concatenate([_flat(wanted[:, ~held]), nothing])
        tested, true = _flat(features[:, held]), _flat(wanted[:, held])
        choices = [(length, ridge) for length in LENGTHS for ridge in RIDGES]
        errors = [
            np.square(cls._fit(learned, shifts, length, ridge)._predict(tested) - true).sum()
            for length, ridge in choices
        ]
        best = choices[int(np.argmin(errors))]
        every = np.concatenate([_flat(features), far])
        return cls._fit(every, np.concatenate([_flat(wanted), nothing]), *best)

    @classmethod
    def _fit(cls, features: Array, wanted: Array, length: float, ridge: float) -> Self:
        same, mirrored = _kernels(features, features, length)
        along = kriging(same + mirrored, wanted[:, _ALONG], ridge)
        across = kriging(same - mirrored, wanted[:, _ACROSS], ridge)
        return cls(features, along, across, length)

    def shift(self, contacts: Array) -> Array:
        """Return the shifts to add to equivalents (S, K, 3), both in mm; zero unless K is 2."""
        out = np.zeros_like(contacts)
        if contacts.shape[1] == 2 and len(self.features):
            for pair in contact_pairs(contacts):
                out[:, pair.i] = pair.to_xy(self._predict(pair.features))
        return out

    def _predict(self, features: Array) -> Array:
        """Return the shifts towards, beside and in depth, (S, 3) mm, of features (S, 5)."""
        same, mirrored = _kernels(features, self.features, self.length)
        out = np.empty((len(features), 3))
        out[:, _ALONG] = (same + mirrored) @ self.along
        out[:, _ACROSS] = (same - mirrored) @ self.across
        return out


def _samples(contacts: Array, left: Array) -> tuple[Array, Array]:
    """Return (2, S, 5) features and (2, S, 3) residual shifts, in the frames of the pairs."""
    pairs = contact_pairs(contacts)
    wanted = [pair.from_xy(left[:, pair.i]) for pair in pairs]
    return np.stack([pair.features for pair in pairs]), np.stack(wanted)


def _far_from(features: Array, contacts: Array) -> Array:
    """Return the features of recombined pairs that are far from given features, (N, 5).

    Args:
        features: (M, 5) given features.
        contacts: (S, 2, 3) mm, pairs that are recombined.
    """
    from scipy.spatial import cKDTree

    anew = np.concatenate([pair.features for pair in contact_pairs(recombined(contacts))])
    far: Array = anew[cKDTree(features).query(anew)[0] > _FAR]
    return far[:: max(1, len(far) // _HELD)]


def _flat(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


def _kernels(a: Array, b: Array, length: float) -> tuple[Array, Array]:
    """Return the kernels (M, N) between features, and between features and mirrored features."""
    return matern(a, b, length), matern(a, b * _MIRROR, length)


FILE = "neighbours.npz"
_CENTRE = np.array([9.0, 3.2, 3.2, -3.0, 0.0])
_SCALE = np.array([3.0, 1.6, 1.6, 4.0, 3.0])
"""Centres and scales of distance, own depth, the neighbour's depth, and own place towards and
beside the neighbour, mm."""
_REACH = 2.2
"""Limit of features, in scales: a polynomial is not valid outside the range it was fitted to."""
PAIR_DEGREE, CROWD_DEGREE = 4, 2
"""Degrees of the polynomials of a pair, and of its change by a third contact."""
_ROUNDS = 8
"""Rounds of reweighting for Huber's loss."""
_KNEE_MM = 0.03
"""Misfit above which Huber's loss of a shift is no longer its square."""
_RIDGE = 1e-5
"""Precision with which coefficients are held to the start, as a share of the number of rows."""
_APART_MM = 5.5
"""Smallest distance of contacts that are recombined, which is that of the shipped coefficients."""
_TURNS = 3
"""Times that every contact of a press is combined with contacts of other presses."""
_STEP = 97
"""Rows between two presses that are combined: neighbouring rows may be alike."""


@dataclass(frozen=True, eq=False)
class NeighbourLaw:
    """The shifts of contacts by their neighbours.

    Attributes:
        pair: (T, 3) coefficients of s, p, h.
        crowd: (2 U, 3) coefficients of their change by a third contact.
    """

    pair: Array
    crowd: Array

    @classmethod
    def none(cls) -> Self:
        """Return the law of contacts that do not act on each other."""
        return cls(np.zeros((_terms(PAIR_DEGREE), 3)), np.zeros((2 * _terms(CROWD_DEGREE), 3)))

    def equivalents(self, contacts: Array) -> Array:
        """Return the equivalents of contacts (S, K, 3) mm, (S, K, 3) mm; NaN stays NaN."""
        return contacts + self.shift(contacts)

    def shift(self, contacts: Array) -> Array:
        """Return the shift from each contact (S, K, 3) mm to its equivalent, (S, K, 3) mm."""
        out = np.zeros_like(contacts)
        for pair in contact_pairs(contacts):
            out[:, pair.i] += pair.to_xy(self._value(pair, contacts))
        return out

    def _value(self, pair: Pair, contacts: Array) -> Array:
        value = _powers(pair.features, PAIR_DEGREE) @ self.pair
        if contacts.shape[1] > 2:
            value = value + _crowd(pair, self._taken(contacts)) @ self.crowd
        return value

    def _taken(self, contacts: Array) -> Array:
        """Return the depth that each contact j takes off contact i as a pair, mm, (S, K, K)."""
        taken = np.zeros((*contacts.shape[:2], contacts.shape[1]))
        for pair in contact_pairs(contacts):
            taken[:, pair.i, pair.j] = _powers(pair.features, PAIR_DEGREE) @ self.pair[:, 2]
        return taken

    @classmethod
    def learn(
        cls, contacts: list[Array], shifts: list[Array], start: Self, elsewhere: float = 0.0
    ) -> Self:
        """Return the law fitted to contacts and their shifts.

        Pairs and crowds are fitted in one linear system (the part of a third contact is linear in
        the depth that it takes off according to ``start``), by iteratively reweighted least squares
        (Huber, 0.03 mm) with a small ridge towards ``start``.

        Args:
            contacts: One (S, K, 3) array for every K > 1, mm.
            shifts: Shifts from these contacts, in arrays of the same shapes, mm.
            start: The law to start from, which is returned where there are no contacts.
            elsewhere: Weight, as a share of that of the shifts, with which the law is held to
                ``start`` at recombined contacts (``recombined``). Presses with one indenter lie on
                a thin sheet of the features and do not determine the polynomial off this sheet.
        """
        if not any(len(presses) for presses in contacts):
            return start
        before = np.concatenate([start.pair, start.crowd])
        rows = np.concatenate([start._design(presses) for presses in contacts])
        wanted = np.concatenate([presses.reshape(-1) for presses in shifts])
        anew = np.concatenate([start._design(recombined(presses)) for presses in contacts])
        held = elsewhere * len(rows) / max(len(anew), 1) * (anew.T @ anew)
        held[np.diag_indices(len(held))] += _RIDGE * len(rows)
        fitted = _robust(rows, wanted, before.T.reshape(-1), held).reshape(3, -1).T
        return cls(*np.split(fitted, [len(start.pair)]))

    def _design(self, contacts: Array) -> Array:
        """Return the derivatives of the shifts by all coefficients, (3 S K, 3 T).

        T is the number of coefficients of a component, those of the pair before those of the crowd.
        """
        frames, count = contacts.shape[:2]
        terms = len(self.pair) + len(self.crowd)
        taken = self._taken(contacts)
        design = np.zeros((frames, count, 3, 3, terms))
        for pair in contact_pairs(contacts):
            parts = [_powers(pair.features, PAIR_DEGREE), _crowd(pair, taken)]
            if count < 3:
                parts[1] = np.zeros_like(parts[1])
            basis = np.concatenate(parts, axis=1)
            for k in range(3):
                turned = pair.to_xy(np.tile(np.eye(3)[k], (frames, 1)))
                design[:, pair.i, :, k] += turned[:, :, None] * basis[:, None]
        return design.reshape(-1, 3 * terms)


def nominal_law(clue: float) -> NeighbourLaw:
    """Return the law from contacts to their equivalents on the nominal dome.

    Args:
        clue: How far the skin follows tips (``drag_clue``).
    """
    return _stored("forward", clue)


def nominal_inverse_law(clue: float) -> NeighbourLaw:
    """Return the law from equivalents to contacts on the nominal dome, fitted by itself.

    Args:
        clue: How far the skin follows tips (``drag_clue``).
    """
    return _stored("inverse", clue)


def _stored(name: str, clue: float) -> NeighbourLaw:
    """Return a shipped law, linear in the clue between the coefficients of friction that ship."""
    with as_file(files(__package__).joinpath(FILE)) as path, np.load(path) as stored:
        clues = stored["clues"]
        pair, crowd = (stored[f"{name}_{part}"].astype(float) for part in ("pair", "crowd"))
    place = float(np.interp(clue, clues, np.arange(len(clues))))
    share = np.maximum(0.0, 1 - np.abs(np.arange(len(clues)) - place))
    return NeighbourLaw(np.tensordot(share, pair, 1), np.tensordot(share, crowd, 1))


@dataclass(frozen=True, eq=False)
class Pair:
    """Contact i and its neighbour j, in S presses.

    Attributes:
        i: Number of the contact.
        j: Number of the neighbour.
        features: (S, 5) scaled features.
        towards: (S, 2) unit vectors towards the neighbour.
        beside: (S, 2) unit vectors at right angles to them.
    """

    i: int
    j: int
    features: Array
    towards: Array
    beside: Array

    def to_xy(self, value: Array) -> Array:
        """Return shifts (S, 3) towards, beside and in depth as shifts in x, y and depth, (S, 3)."""
        xy = self.towards * value[:, :1] + self.beside * value[:, 1:2]
        return np.concatenate([xy, value[:, 2:]], axis=1)

    def from_xy(self, value: Array) -> Array:
        """Return shifts (S, 3) in x, y and depth as shifts towards, beside and in depth, (S, 3)."""
        along, across = ((value[:, :2] * axis).sum(axis=1) for axis in (self.towards, self.beside))
        return np.stack([along, across, value[:, 2]], axis=1)


def contact_pairs(contacts: Array) -> list[Pair]:
    """Return the pairs of every contact of (S, K, 3) mm with every other contact."""
    return [
        _pair_of(contacts, i, j)
        for i in range(contacts.shape[1])
        for j in range(contacts.shape[1])
        if i != j
    ]


def _pair_of(contacts: Array, i: int, j: int) -> Pair:
    apart = contacts[:, j, :2] - contacts[:, i, :2]
    distance = np.maximum(np.hypot(*apart.T), 1e-6)
    towards = apart / distance[:, None]
    beside = np.stack([-towards[:, 1], towards[:, 0]], axis=1)
    xy = contacts[:, i, :2]
    place = [(xy * towards).sum(axis=1), (xy * beside).sum(axis=1)]
    raw = np.stack([distance, contacts[:, i, 2], contacts[:, j, 2], *place], axis=1)
    return Pair(i, j, ((raw - _CENTRE) / _SCALE).clip(-_REACH, _REACH), towards, beside)


def _crowd(pair: Pair, taken: Array) -> Array:
    """Return the features of a crowd, (S, 2 U).

    These are the depths that other contacts take off i, and off j, each times the powers of the
    pair.

    Args:
        pair: Contacts i and j.
        taken: (S, K, K) depth that each contact takes off another, mm.
    """
    powers = _powers(pair.features, CROWD_DEGREE)
    off_i = taken[:, pair.i].sum(axis=1) - taken[:, pair.i, pair.j]
    off_j = taken[:, pair.j].sum(axis=1) - taken[:, pair.j, pair.i]
    return np.concatenate([off_i[:, None] * powers, off_j[:, None] * powers], axis=1)


@cache
def _products(degree: int) -> tuple[tuple[int, ...], ...]:
    """Return the features of every product up to a degree, in rising degree."""
    return tuple(
        product for d in range(degree + 1) for product in combinations_with_replacement(range(5), d)
    )


@cache
def _growth(degree: int) -> list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
    """Return for every degree from 1 how its products follow from those of the degree before.

    These are the number of the shorter product, and the feature that multiplies it.
    """
    ranks = [[term for term in _products(degree) if len(term) == d] for d in range(degree + 1)]
    return [
        (
            np.array([shorter.index(product[:-1]) for product in longer]),
            np.array([product[-1] for product in longer]),
        )
        for shorter, longer in pairwise(ranks)
    ]


def _terms(degree: int) -> int:
    return len(_products(degree))


def _powers(features: Array, degree: int) -> Array:
    """Return all products of the features (S, 5) up to a degree, (S, T)."""
    blocks = [np.ones((len(features), 1))]
    for shorter, last in _growth(degree):
        blocks.append(blocks[-1][:, shorter] * features[:, last])
    return np.concatenate(blocks, axis=1)


def recombined(contacts: Array) -> Array:
    """Return recombined contacts of different presses, 5.5 mm or more apart, (S', K, 3) mm.

    Every contact of (S, K, 3) keeps its place and depth, but has neighbours of other presses.
    """
    each = contacts.shape[1]
    anew = np.concatenate(
        [
            np.stack(
                [np.roll(contacts[:, (k + turn) % each], _STEP * k * turn, 0) for k in range(each)],
                axis=1,
            )
            for turn in range(1, _TURNS + 1)
        ]
    )
    gaps = [anew[:, i, :2] - anew[:, j, :2] for i in range(each) for j in range(i)]
    apart: Array = np.linalg.norm(gaps, axis=-1)
    return np.asarray(anew[(apart >= _APART_MM).all(axis=0)])


def _robust(rows: Array, wanted: Array, start: Array, held: Array) -> Array:
    """Return the coefficients with the least Huber loss, (T,).

    Args:
        rows: (R, T) derivatives of the shifts by the coefficients.
        wanted: (R,) shifts, mm.
        start: (T,) coefficients to which the result is held.
        held: (T, T) precision with which it is held.
    """
    solution = start
    for turn in range(_ROUNDS):
        off = np.abs(wanted - rows @ solution)
        weight = np.ones(len(rows)) if turn == 0 else np.minimum(1.0, _KNEE_MM / (off + 1e-9))
        weighted = rows * weight[:, None]
        normal = weighted.T @ rows + held
        solution = start + np.linalg.solve(normal, weighted.T @ (wanted - rows @ start))
    return solution
