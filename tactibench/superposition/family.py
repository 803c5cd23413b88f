"""Fields of one contact on the sensors of one make: what they share, and how they vary.

    u(c; z) = F_0(c) + sum_k z_k F_k(c)

Every sensor has a few numbers z, as factors in a factor analysis. They are learned by turns from
single presses on many sensors: with z known, all fields are kriged together; with the fields known,
z of a sensor is a linear regression of its presses. The pins at rest say something about z, which
is another regression; labelled presses of a sensor say most of the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition.field import Field, Presses

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.intp]

WAYS = 4
"""Numbers of a sensor, at most."""
SENSORS_A_WAY = 3
"""Sensors that a training needs for every number, or else it would describe each by itself."""
_AMPLITUDE = 0.1
"""Deviation of a way of variation, of that of the mean field, that is expected beforehand. Freer
ways take up the noise: with 0.3 contacts on twenty unseen sensors were 0.0139 mm off, with this
0.0111."""
_RIDGE = 3e-8
"""Variance of noise against that of the mean field. On twenty unseen sensors, each with 50 labelled
presses, contacts were 0.0047 mm off; with a third as much 0.0052 and with three times 0.0050."""
_PITCH_MM = (0.56, 0.56, 0.35)
"""Pitch of the lattice."""
_ROUNDS = 4
"""Turns; the misfit settles after three."""
_MOST, _ROUGH_MM = 1500, (1.4, 1.4, 0.7)
"""Presses, and pitch of the lattice, of the field from which z is guessed first."""
CLUES = 2
"""Numbers of a rest layout: its size, and the first way in which shapes of layouts differ."""
_NOISE_PX = 0.012
"""Deviation of a displacement while z is learned."""
_SHRINK = 1e-2
"""Ridge of regressions, in presses or sensors."""


@dataclass(frozen=True, eq=False)
class Clues:
    """Size and shape of rest layouts, as numbers of deviation 1 over the training sensors."""

    mean: Array
    """(1 + Q,) of the logarithm of the size, and of the pins' deviations from the layout, px."""
    axes: Array
    """(CLUES, 1 + Q)."""

    @classmethod
    def learn(cls, rests: Array) -> Self:
        """Learn from (S, 1 + Q) sizes and deviations of the training's sensors."""
        mean = rests.mean(axis=0)
        size, shape = (rests - mean)[:, :1], (rests - mean)[:, 1:]
        _, spreads, ways = np.linalg.svd(shape, full_matrices=False)
        axes = np.zeros((CLUES, rests.shape[1]))
        axes[0, 0] = 1 / max(float(size.std()), 1e-6)
        for k in range(min(CLUES - 1, len(spreads))):
            axes[1 + k, 1:] = ways[k] / max(spreads[k] / np.sqrt(len(rests)), 1e-3)
        return cls(mean, axes)

    def __call__(self, rests: Array) -> Array:
        """Return (S, 1 + CLUES): 1 and the clues of rest layouts (S, 1 + Q)."""
        clues = (rests - self.mean) @ self.axes.T
        return np.concatenate([np.ones((len(rests), 1)), clues], axis=1)


@dataclass(frozen=True, eq=False)
class FieldFamily:
    """The fields of sensors of one make, and what is known of a sensor's z beforehand."""

    field: Field
    """With V ways; V = 0: a single sensor's."""
    clues: Clues
    slopes: Array
    """(1 + CLUES, V): the expected z by the clues of its rest layout."""
    covariance: Array
    """(V, V) of z about that."""

    @classmethod
    def learn(cls, contacts: Array, values: Array, sensors: Numbers, rests: Array) -> Self:
        """Learn from single presses on S sensors.

        Args:
            contacts: (N, 3) mm.
            values: (N, Q) displacements on the common layout, px.
            sensors: (N,) number of the sensor of a press, 0 to S - 1.
            rests: (S, 1 + Q) size and deviations of the rest layouts.
        """
        ways = min(WAYS, len(rests) // SENSORS_A_WAY)
        if not ways:
            field = Field.learn(contacts, values)
            return cls(field, Clues.learn(rests), np.zeros((1 + CLUES, 0)), np.zeros((0, 0)))
        some = slice(None, None, -(-len(contacts) // _MOST))
        rough = Field.learn(contacts[some], values[some], pitch=_ROUGH_MM)
        z = _first_guess(contacts, values - rough(contacts), sensors, len(rests), ways)
        for _ in range(_ROUNDS):
            presses = Presses.of(contacts, values, _shares(z)[sensors])
            parts = presses.fields(contacts, presses.weights(_RIDGE))
            parts = parts.reshape(len(contacts), 1 + ways, -1)
            z = _whitened(_regress(parts, values, sensors, len(rests)))
        field = Field.learn(contacts, values, _shares(z)[sensors], _PITCH_MM, _RIDGE)
        field = field.turned(np.zeros(ways), _AMPLITUDE * np.eye(ways))
        clues = Clues.learn(rests)
        seen = clues(rests)
        normal = seen.T @ seen + _SHRINK * np.eye(1 + CLUES)
        slopes = np.asarray(np.linalg.solve(normal, seen.T @ z), dtype=np.float64)
        left = z - seen @ slopes
        covariance: Array = left.T @ left / len(left) + 1e-3 * np.eye(ways)
        return cls(field, clues, slopes, covariance)

    def of_sensor(
        self, rest: Array, contacts: Array | None = None, values: Array | None = None
    ) -> Field:
        """Return the field of one sensor; its nuisances, of deviation 1, are what is left unknown.

        Args:
            rest: (1 + Q,) size and deviations of its rest layout.
            contacts: (N, 3) mm of single presses on it that are known; None: none are.
            values: (N, Q) their displacements, px.
        """
        if not self.field.ways:
            return self.field
        expected = (self.clues(rest[None]) @ self.slopes)[0]
        precision = np.linalg.inv(self.covariance)
        if contacts is not None and values is not None and len(contacts):
            normal, pull = _evidence(self.field.slopes(contacts)[:, 0], values)
            wanted = precision @ expected + pull
            precision = precision + normal
            expected = np.linalg.solve(precision, wanted)
        axes = np.linalg.cholesky(np.linalg.inv(precision))
        return self.field.turned(expected, axes)


def _first_guess(contacts: Array, left: Array, sensors: Numbers, count: int, ways: int) -> Array:
    """(S, V) z: principal components of smooth residuals, one regression a sensor."""
    x, y, depth = ((contacts - contacts.mean(axis=0)) / contacts.std(axis=0)).T
    basis = contacts[:, 2:] * np.stack(
        [np.ones_like(x), depth, x, y, x * x, y * y, x * y, depth * depth], axis=1
    )
    ridge = _SHRINK * np.square(basis).mean() * np.eye(basis.shape[1])
    fits = []
    for sensor in range(count):
        own = basis[sensors == sensor]
        fits.append(np.linalg.solve(own.T @ own + ridge, own.T @ left[sensors == sensor]).ravel())
    centred = np.array(fits) - np.mean(fits, axis=0)
    return _whitened(np.linalg.svd(centred, full_matrices=False)[0][:, :ways])


def _regress(parts: Array, values: Array, sensors: Numbers, count: int) -> Array:
    """(S, V) z of every sensor; parts: (N, 1 + V, Q) the fields at its presses, of amplitude 1."""
    scaled = np.concatenate([parts[:, :1], _AMPLITUDE * parts[:, 1:]], axis=1)
    fields = []
    for sensor in range(count):
        own = sensors == sensor
        normal, pull = _evidence(scaled[own], values[own])
        fields.append(np.linalg.solve(normal + np.eye(len(normal)), pull))
    return np.array(fields)


def _evidence(parts: Array, values: Array) -> tuple[Array, Array]:
    """The information (V, V) on z of a sensor in its presses, and its product with z (V,).

    parts: (N, 1 + V, Q) the mean and the ways of variation at the presses; values: (N, Q).
    """
    ways = parts[:, 1:].transpose(1, 0, 2).reshape(parts.shape[1] - 1, -1) / _NOISE_PX
    left = (values - parts[:, 0]).reshape(-1) / _NOISE_PX
    return ways @ ways.T, ways @ left


def _shares(z: Array) -> Array:
    """(S, 1 + V) of the mean and of every way of variation in the field of a sensor."""
    return np.concatenate([np.ones((len(z), 1)), _AMPLITUDE * z], axis=1)


def _whitened(z: Array) -> Array:
    """Numbers (S, V) with mean 0 and unit covariance over the sensors."""
    centred = z - z.mean(axis=0)
    covariance = centred.T @ centred / len(z) + 1e-9 * np.eye(z.shape[1])
    out: Array = np.linalg.solve(np.linalg.cholesky(covariance), centred.T).T
    return out
