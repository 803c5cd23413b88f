"""The field of one contact: displacements of the pins as a smooth function of its x, y and depth.

It is learned from single presses. Gaussian-process regression (kriging) with a Matern-5/2 kernel
gives the field. A cubic spline on a regular lattice stores it, so that a value costs 64 products
per pin, whatever the number of presses.

Sensors of one make have fields that differ by a few numbers z of each sensor (module ``family``),

    u(c; z) = F_0(c) + sum_k z_k F_k(c)

with a mean F_0 and V ways F_k in which they vary. The field of one sensor is the case V = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts
from tactibench.errors import UserError
from tactibench.superposition.compiled import evaluate

Array = npt.NDArray[np.float64]
Lattice = npt.NDArray[np.float32]

LENGTH_MM = 30.0
"""Length of the kernel: far longer than the workspace, so that the field is a stiff spline."""
RIDGES = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Variances of noise relative to that of the field; the one that predicts held-out presses best is
used."""
FEWEST = 20
"""Presses below which no field is fitted: fewer than two would be held out."""
PITCH_MM = (0.7, 0.7, 0.35)
"""Pitch of the lattice in x, y, depth: the field bends most over depth, just after first touch."""
MARGIN_MM = 1.0
"""The lattice reaches this far beyond the presses; beyond it, the value at its edge is used."""
_RESTING = 7
"""Presses of depth 0 along each side: at depth 0 the field is known to be zero."""
_HELD_OUT = 10
"""One press in this many is held out to choose the ridge."""


@dataclass(frozen=True, eq=False)
class Field:
    """Q quantities as functions of x, y and depth; they are 0 without contact.

    Attributes:
        coefficients: (X, Y, D, (1 + V) Q) of the cubic B-splines, the mean before the ways of
            variation.
        low: (3,) mm, the first knot of each axis.
        step: (3,) mm between knots.
        ways: V, the number of ways in which fields of sensors of one make vary.
    """

    coefficients: Lattice
    low: Array
    step: Array
    ways: int = 0

    @classmethod
    def learn(
        cls,
        contacts: Array,
        values: Array,
        shares: Array | None = None,
        pitch: Sequence[float] = PITCH_MM,
        ridge: float | None = None,
    ) -> Self:
        """Learn the field from single presses.

        Args:
            contacts: (N, 3) x, y and depth, mm.
            values: (N, Q) quantities.
            shares: (N, 1 + V) shares of the mean, 1, and of every way of variation in the field of
                a press, which are the z of its sensor; None where all presses are of one sensor.
            pitch: Pitch of the lattice along each axis, mm.
            ridge: Variance of the noise relative to that of the field; None to choose it on presses
                that are held out.

        Raises:
            UserError: There are fewer than twenty presses.
        """
        if shares is None:
            shares = np.ones((len(contacts), 1))
        if len(contacts) < FEWEST:
            raise UserError(
                f"a field of single presses is learned from {len(contacts)} presses; it needs at "
                f"least {FEWEST}: raise the training count."
            )
        presses = Presses.of(contacts, values, shares)
        low = np.append(contacts[:, :2].min(axis=0) - MARGIN_MM, 0.0)
        high = contacts.max(axis=0) + MARGIN_MM
        knots = np.maximum(4, np.ceil((high - low) / np.array(pitch)).astype(int) + 1)
        step = (high - low) / (knots - 1)
        axes = [a + s * np.arange(n) for a, s, n in zip(low, step, knots, strict=True)]
        weights = presses.weights(_best_ridge(contacts, values, shares) if ridge is None else ridge)
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        lattice = np.concatenate(
            [presses.fields(part, weights) for part in np.array_split(nodes, len(nodes) // 500 + 1)]
        )
        return cls(_spline(lattice.reshape(*knots, -1)), low, step, shares.shape[1] - 1)

    @property
    def quantities(self) -> int:
        """Number of quantities Q."""
        return int(self.coefficients.shape[3]) // (1 + self.ways)

    @property
    def high(self) -> Array:
        """(3,) mm, the last knot of each axis."""
        high: Array = self.low + self.step * (np.array(self.coefficients.shape[:3]) - 1)
        return high

    def __call__(self, contacts: npt.ArrayLike, z: Array | None = None) -> Array:
        """Return the values of contacts, (..., Q).

        Args:
            contacts: (..., 3) x, y and depth, mm.
            z: (V,) numbers of the sensor; None for the values of the mean.
        """
        values = self.slopes(contacts)[..., 0, :, :]
        if z is None or not self.ways:
            return values[..., 0, :]
        out: Array = np.concatenate([np.ones(1), z]) @ values
        return out

    def slopes(self, contacts: npt.ArrayLike) -> Array:
        """Return the values and their derivatives by x, y and depth, 1/mm.

        Args:
            contacts: (..., 3) x, y and depth, mm.

        Returns:
            (..., 4, 1 + V, Q) of the mean and of every way of variation.
        """
        places: Array = np.asarray(contacts, dtype=np.float64)
        flat = np.ascontiguousarray(places.reshape(-1, 3))
        out = np.empty((len(flat), 4, self.coefficients.shape[3]), dtype=np.float32)
        evaluate(self.coefficients, self.low, self.step, flat, out)
        shape = (*places.shape[:-1], 4, 1 + self.ways, self.quantities)
        return out.reshape(shape).astype(np.float64)

    def turned(self, origin: Array, axes: Array) -> Self:
        """Return the fields u(c; origin + axes z'), which vary with z' (W,).

        Args:
            origin: (V,) z of the new mean.
            axes: (V, W) columns by which z varies.
        """
        mixing = np.zeros((1 + self.ways, 1 + axes.shape[1]))
        mixing[0, 0], mixing[1:, 0], mixing[1:, 1:] = 1.0, origin, axes
        knots = self.coefficients.shape[:3]
        parts = self.coefficients.reshape(*knots, 1 + self.ways, -1)
        mixed = np.einsum("vw,xydvq->xydwq", mixing.astype(np.float32), parts)
        return type(self)(
            np.ascontiguousarray(mixed).reshape(*knots, -1), self.low, self.step, axes.shape[1]
        )


def matern(a: Array, b: Array, length: float) -> Array:
    """Return the Matern-5/2 kernel (1 + r + r^2 / 3) exp(-r), r = sqrt(5) |a - b| / length.

    Args:
        a: (M, D) places.
        b: (N, D) places.
        length: Length of the kernel, in the unit of the places.

    Returns:
        (M, N) kernel.
    """
    from scipy.spatial.distance import cdist

    r = cdist(a, b) * (np.sqrt(5.0) / length)
    value: Array = (1 + r + r * r / 3) * np.exp(-r)
    return value


def kriging(kernel: Array, values: Array, ridge: float) -> Array:
    """Return the (N, Q) weights that, multiplied by a kernel (M, N), predict values at M places.

    Args:
        kernel: (N, N) kernel of the known places, which is overwritten.
        values: (N, Q) values at the known places.
        ridge: Variance of the noise relative to that of the values.
    """
    from scipy.linalg import cho_factor, cho_solve

    kernel[np.diag_indices(len(kernel))] += ridge
    weights: Array = cho_solve(cho_factor(kernel, overwrite_a=True), values)
    return weights


def _kernel(a: Array, b: Array) -> Array:
    return matern(a, b, LENGTH_MM)


@dataclass(frozen=True, eq=False)
class Presses:
    """Presses with their values, and places at which nothing presses, where every field is 0.

    Attributes:
        places: (M, 3) x, y and depth, mm.
        targets: (M, Q) values.
        shares: (M, 1 + V) shares of the mean and of every way of variation.
    """

    places: Array
    targets: Array
    shares: Array

    @classmethod
    def of(cls, contacts: Array, values: Array, shares: Array) -> Self:
        """Return presses, with places added at which nothing presses.

        Args:
            contacts: (N, 3) x, y and depth, mm.
            values: (N, Q) quantities.
            shares: (N, 1 + V) shares of the mean and of every way of variation.
        """
        sides = [
            np.linspace(low, high, _RESTING)
            for low, high in zip(contacts.min(axis=0)[:2], contacts.max(axis=0)[:2], strict=True)
        ]
        x, y = (axis.ravel() for axis in np.meshgrid(*sides))
        resting = np.stack([x, y, 0 * x], axis=1)
        fields = shares.shape[1]
        return cls(
            np.concatenate([contacts, *[resting] * fields]),
            np.concatenate([values, np.zeros((fields * len(resting), values.shape[1]))]),
            np.concatenate([shares, np.repeat(np.eye(fields), len(resting), axis=0)]),
        )

    def weights(self, ridge: float) -> Array:
        """Return the (M, Q) weights of kriging; the covariances of independent fields add up."""
        kernel = _kernel(self.places, self.places) * (self.shares @ self.shares.T)
        return kriging(kernel, self.targets, ridge)

    def fields(self, contacts: Array, weights: Array) -> Array:
        """Return the fields at contacts (N, 3) mm, (N, (1 + V) Q), one field after the other."""
        kernel = _kernel(contacts, self.places)
        return np.concatenate([kernel @ (share[:, None] * weights) for share in self.shares.T], 1)


def _best_ridge(contacts: Array, values: Array, shares: Array) -> float:
    """Return the ridge with the least squared error on every tenth press.

    To bound the time at most 1,500 presses are learned from and 200 are tested.
    """
    held = np.arange(len(contacts)) % _HELD_OUT == 0
    learned = np.flatnonzero(~held)[:1500]
    presses = Presses.of(contacts[learned], values[learned], shares[learned])
    test = np.flatnonzero(held)[:200]
    kernel = _kernel(contacts[test], presses.places) * (shares[test] @ presses.shares.T)
    errors = [
        float(((kernel @ presses.weights(ridge) - values[test]) ** 2).sum()) for ridge in RIDGES
    ]
    return RIDGES[int(np.argmin(errors))]


def _spline(lattice: Array) -> Lattice:
    from scipy.ndimage import spline_filter1d

    for axis in range(3):
        lattice = spline_filter1d(lattice, order=3, axis=axis, mode="mirror")
    out: Lattice = np.ascontiguousarray(lattice, dtype=np.float32)
    return out


def single_press_rows(truth: Sequence[Answer]) -> npt.NDArray[np.intp]:
    """Return the rows with exactly one contact.

    Raises:
        UserError: An answer is a plate pose.
    """
    if not all(isinstance(answer, Contacts) for answer in truth):
        raise UserError(
            "single presses are superposed by contacts, and these frames are labelled with plate "
            "poses; use another model, or leave mixing out."
        )
    return np.flatnonzero([len(answer) == 1 for answer in truth])  # type: ignore[arg-type]


def contact_array(truth: Sequence[Answer]) -> Array:
    """Return x, y and depth of answers that have K contacts each, (N, K, 3) mm."""
    return np.stack(
        [
            np.column_stack([answer.xy, answer.depth])
            for answer in truth
            if isinstance(answer, Contacts)
        ]
    )
