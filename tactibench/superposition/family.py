"""Fields of one contact on the sensors of one make: their common mean and their variation.

    u(c; z) = F_0(c) + sum_k z_k F_k(c)

Every sensor has a few numbers z, like factors in a factor analysis. Fields and z are learned in
turns from single presses on many sensors: with z known, all fields are kriged together; with the
fields known, z of a sensor is a linear regression of its presses. The pins at rest determine z in
part, by another regression; labelled presses of a sensor determine most of the rest.
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
"""Most numbers z of a sensor."""
SENSORS_A_WAY = 3
"""Sensors that a training needs for every number; with fewer, each number would describe one
sensor."""
_AMPLITUDE = 0.1
"""Prior standard deviation of a way of variation, as a share of that of the mean field. Freer ways
fit the noise: with 0.3 contacts on twenty unseen sensors were 0.0139 mm off, with this value
0.0111."""
_RIDGE = 3e-8
"""Variance of the noise relative to that of the mean field. On twenty unseen sensors, each with 50
labelled presses, contacts were 0.0047 mm off; with a third of it 0.0052 and with three times it
0.0050."""
_PITCH_MM = (0.56, 0.56, 0.35)
"""Pitch of the lattice in x, y and depth."""
_ROUNDS = 4
"""Rounds of learning z and the fields; the misfit settles after three."""
_MOST, _ROUGH_MM = 1500, (1.4, 1.4, 0.7)
"""Most presses, and pitch of the lattice, of the field from which the first z are guessed."""
CLUES = 2
"""Numbers of a rest layout: its size, and the first way in which the shapes of layouts differ."""
_NOISE_PX = 0.012
"""Standard deviation of a displacement while z is learned."""
_SHRINK = 1e-2
"""Ridge of regressions, as a number of presses or sensors."""


@dataclass(frozen=True, eq=False)
class Clues:
    """Size and shape of rest layouts, as numbers of standard deviation 1 over training sensors.

    Attributes:
        mean: (1 + Q,) mean of the logarithm of the size, and of the pins' deviations from the
            layout, px.
        axes: (CLUES, 1 + Q) by which deviations from the mean are multiplied.
    """

    mean: Array
    axes: Array

    @classmethod
    def learn(cls, rests: Array) -> Self:
        """Return the clues of S training sensors.

        Args:
            rests: (S, 1 + Q) logarithm of the size, and deviations of the pins from the layout, px.
        """
        mean = rests.mean(axis=0)
        size, shape = (rests - mean)[:, :1], (rests - mean)[:, 1:]
        _, spreads, ways = np.linalg.svd(shape, full_matrices=False)
        axes = np.zeros((CLUES, rests.shape[1]))
        axes[0, 0] = 1 / max(float(size.std()), 1e-6)
        for k in range(min(CLUES - 1, len(spreads))):
            axes[1 + k, 1:] = ways[k] / max(spreads[k] / np.sqrt(len(rests)), 1e-3)
        return cls(mean, axes)

    def __call__(self, rests: Array) -> Array:
        """Return 1 and the clues of rest layouts (S, 1 + Q), (S, 1 + CLUES)."""
        clues = (rests - self.mean) @ self.axes.T
        return np.concatenate([np.ones((len(rests), 1)), clues], axis=1)


@dataclass(frozen=True, eq=False)
class FieldFamily:
    """The fields of sensors of one make, and the prior of a sensor's z.

    Attributes:
        field: The fields, with V ways of variation; V = 0 for a training with few sensors.
        clues: Clues of rest layouts.
        slopes: (1 + CLUES, V) from the clues of a rest layout to the expected z.
        covariance: (V, V) of z about its expectation.
    """

    field: Field
    clues: Clues
    slopes: Array
    covariance: Array

    @classmethod
    def learn(cls, contacts: Array, values: Array, sensors: Numbers, rests: Array) -> Self:
        """Learn the fields from single presses on S sensors.

        Args:
            contacts: (N, 3) x, y and depth, mm.
            values: (N, Q) displacements on the common layout, px.
            sensors: (N,) number of the sensor of a press, 0 to S - 1.
            rests: (S, 1 + Q) size and deviations of the rest layouts.

        Raises:
            UserError: There are fewer than twenty presses.
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
        """Return the field of one sensor.

        Its ways of variation are the remaining uncertainty: their numbers have standard deviation
        1.

        Args:
            rest: (1 + Q,) size and deviations of its rest layout.
            contacts: (N, 3) mm, labelled single presses on it; None where there are none.
            values: (N, Q) displacements of these presses, px.
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
    """Return first z of the sensors, (S, V): principal components of smooth residuals.

    The residuals of each sensor are smoothed by a regression on its contacts.

    Args:
        contacts: (N, 3) x, y and depth, mm.
        left: (N, Q) residuals of a common field, px.
        sensors: (N,) number of the sensor of a press.
        count: Number of sensors S.
        ways: Number of ways of variation V.
    """
    x, y, depth = ((contacts - contacts.mean(axis=0)) / contacts.std(axis=0)).T
    basis = contacts[:, 2:] * np.stack(
        [np.ones_like(x), depth, x, y, x * x, y * y, x * y, depth * depth], axis=1
    )
    ridge = _SHRINK * np.square(basis).mean() * np.eye(basis.shape[1])
    fits = []
    for sensor in range(count):
        rows = basis[sensors == sensor]
        fits.append(
            np.linalg.solve(rows.T @ rows + ridge, rows.T @ left[sensors == sensor]).ravel()
        )
    centred = np.array(fits) - np.mean(fits, axis=0)
    return _whitened(np.linalg.svd(centred, full_matrices=False)[0][:, :ways])


def _regress(parts: Array, values: Array, sensors: Numbers, count: int) -> Array:
    """Return z of every sensor, (S, V).

    Args:
        parts: (N, 1 + V, Q) mean and ways of variation at the presses, of amplitude 1.
        values: (N, Q) displacements, px.
        sensors: (N,) number of the sensor of a press.
        count: Number of sensors S.
    """
    scaled = np.concatenate([parts[:, :1], _AMPLITUDE * parts[:, 1:]], axis=1)
    fields = []
    for sensor in range(count):
        rows = sensors == sensor
        normal, pull = _evidence(scaled[rows], values[rows])
        fields.append(np.linalg.solve(normal + np.eye(len(normal)), pull))
    return np.array(fields)


def _evidence(parts: Array, values: Array) -> tuple[Array, Array]:
    """Return the information of presses on z of their sensor, (V, V), and its product with z, (V,).

    Args:
        parts: (N, 1 + V, Q) mean and ways of variation at the presses.
        values: (N, Q) displacements, px.
    """
    ways = parts[:, 1:].transpose(1, 0, 2).reshape(parts.shape[1] - 1, -1) / _NOISE_PX
    left = (values - parts[:, 0]).reshape(-1) / _NOISE_PX
    return ways @ ways.T, ways @ left


def _shares(z: Array) -> Array:
    """Return the shares of the mean and of the ways of variation in sensors' fields, (S, 1 + V)."""
    return np.concatenate([np.ones((len(z), 1)), _AMPLITUDE * z], axis=1)


def _whitened(z: Array) -> Array:
    """Return numbers (S, V), transformed to mean 0 and unit covariance over the sensors."""
    centred = z - z.mean(axis=0)
    covariance = centred.T @ centred / len(z) + 1e-9 * np.eye(z.shape[1])
    out: Array = np.linalg.solve(np.linalg.cholesky(covariance), centred.T).T
    return out
