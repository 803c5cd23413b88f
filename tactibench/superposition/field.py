"""The field of one contact: displacements of the pins as a smooth function of its x, y and depth.

It is learned from single presses. Gaussian-process regression (kriging) with a Matern-5/2 kernel
gives the field. A cubic spline on a regular lattice stores it, so that a value costs 64 products
per pin, whatever the number of presses.

Sensors of one make have fields that differ by a few numbers z of each sensor (``FieldFamily``),

    u(c; z) = F_0(c) + sum_k z_k F_k(c)

with a mean F_0 and V ways F_k in which they vary. The field of one sensor is the case V = 0.
Where tips rub, friction differs from press to press: then there is one more way, whose number
belongs to the press (``press_numbers``) and not to the sensor.

Fields of one contact on the sensors of one make: their common mean and their variation.

    u(c; z) = F_0(c) + sum_k z_k F_k(c)

Every sensor has a few numbers z, like factors in a factor analysis. Fields and z are learned in
turns from single presses on many sensors: with z known, all fields are kriged together; with the
fields known, z of a sensor is a linear regression of its presses. The pins at rest determine z in
part, by another regression; labelled presses of a sensor determine most of the rest.

Least squares of several contacts whose fields add up, by damped Gauss-Newton.

Besides the contacts a frame may depend on a few nuisances n: the numbers by which its sensor
differs from the mean of its make (``Field.ways``), and the motion of the image. They are fitted
together with the contacts; the prior of each is normal with standard deviation 1. The size of the
misfit is not known beforehand: several contacts are superposed with errors far beyond the camera's
noise. So the variance s of the noise follows from the fit itself and is at least 1:

    misfit / s + Q log s + |n|^2,    s = max(misfit / Q, 1)

is minimised. This is the likelihood of n with the best variance. Misfit beyond the camera's noise
is correlated, so the numbers of sensor and press in |n|^2 then count more (``Field.correlated``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts
from tactibench.errors import UserError
from tactibench.superposition.compiled import evaluate, fit_frame, hold_of

_STEPS = 12
"""Most steps of a frame."""
_SHALLOWEST_MM = 0.02
"""Smallest depth of a contact: at depth 0 its place has no effect, and a step no direction."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Contacts of S frames.

    Attributes:
        contacts: (S, K, 3) x, y, depth, mm.
        left: (S, Q) residual displacements.
        normal: (S, 3 K, 3 K) information on the contacts, with the nuisances unknown.
        nuisances: (S, M) numbers of the field's ways of variation, then of the image's motions.
    """

    contacts: Array
    left: Array
    normal: Array
    nuisances: Array


def solve(
    field: Field,
    moved: Array,
    start: Array,
    weight: Array,
    steps: int = _STEPS,
    whitener: Array | None = None,
    motions: Array | None = None,
) -> Solution:
    """Minimise the squared misfit over the contacts and the nuisances n.

        misfit = sum_q weight_q (moved_q - sum_k field_q(contact_k; n) - (n motions)_q)^2

    The method is Levenberg-Marquardt with one damping per frame; a step that does not help is taken
    back.

    Args:
        field: Field of one contact.
        moved: (S, Q) displacements.
        start: (S, K, 3) x, y and depth at which the fit starts, mm.
        weight: (Q,) or (S, Q), 1 / variance.
        steps: Most steps of a frame.
        whitener: (Q, M) by which residuals are multiplied before they are weighted, for
            displacements whose errors are not independent; weight is then (M,) or (S, M), and
            ``left`` of the solution (S, M).
        motions: (R, Q) displacements by each motion of the image; None where it has not moved.
    """
    motions = np.empty((0, moved.shape[1])) if motions is None else motions
    whitener = np.empty((0, 0)) if whitener is None else np.ascontiguousarray(whitener)
    frames, count = start.shape[:2]
    contacts = np.array(start, dtype=np.float64, order="C")
    nuisances = np.zeros((frames, field.ways + len(motions)))
    left = np.empty((frames, whitener.shape[1] if len(whitener) else moved.shape[1]))
    size = 3 * count + nuisances.shape[1]
    normal = np.empty((frames, size, size))
    low = np.array([*field.low[:2], _SHALLOWEST_MM])
    arrays = field.coefficients, field.low, field.step, field.ways, low, field.high
    correlated = field.correlated(count, len(motions))
    weights = np.broadcast_to(np.asarray(weight, dtype=np.float64), left.shape)
    for k in range(frames):
        fit_frame(
            arrays,
            motions,
            np.ascontiguousarray(moved[k], dtype=np.float64),
            np.ascontiguousarray(weights[k]),
            whitener,
            steps,
            correlated,
            contacts[k],
            nuisances[k],
            left[k],
            normal[k],
        )
    return Solution(contacts, left, _information(normal, 3 * count), nuisances)


def cost_of(solution: Solution, weight: Array, correlated: Array) -> float:
    """Return the misfit of one frame plus the penalty of its nuisances in units of the misfit.

    Args:
        solution: Solution of the frame.
        weight: (Q,) 1 / variance.
        correlated: (N,) how strongly nuisances are held (``Field.correlated``).
    """
    misfit = float((weight * solution.left[0] ** 2).sum())
    noise = max(misfit / len(weight), 1.0)
    held = hold_of(noise, correlated)
    return misfit + noise * float((held * solution.nuisances[0] ** 2).sum())


def _information(normal: Array, count: int) -> Array:
    """Return the information on the first ``count`` parameters, with the others eliminated.

    This is the Schur complement.
    """
    if normal.shape[1] == count:
        return normal
    across = normal[:, :count, count:]
    others = np.linalg.solve(normal[:, count:, count:], across.transpose(0, 2, 1))
    information: Array = normal[:, :count, :count] - across @ others
    return information


Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.intp]

WAYS = 4
"""Most numbers z of a sensor."""
SENSORS_A_WAY = 3
"""Sensors that a training needs for every number; with fewer, each number would describe one
sensor."""
CORRELATED = 20.0
"""Number of displacements that err together beyond the noise, where one contact presses: the
residual is smooth over the skin, and determines the numbers of sensor and press no better than a
twentieth as many displacements would. Of 1, 5 and 20 this value left the least error in depth on
training instances."""
CROWDED = 2000.0
"""The same for the numbers of a sensor where several contacts press. What their law leaves would be
taken for another sensor: on six instances that are neither trained nor tested on (80 to 85), pairs
came out 0.47 mm too near or too far apart with 20, 0.19 mm with 200 and 0.16 mm with this value
(trained on 64 instances)."""
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
_PRESS_RIDGE = 3e-7
"""As ``_RIDGE``, where a number of every press is learned from the same presses: with the smaller
value the numbers follow the noise."""
_CLUE_MM, _CIRCLE = (5.0, 3.0), 12
"""Radius of the circle and depth of the presses at which a field shows friction, and their number:
far from the axis, where tips would slide, and deep, where they push the skin."""
_PRESS_ROUNDS = 3
"""Rounds of learning the numbers of presses; the misfit settles after two."""
_PRESS_SHARE = 0.3
"""Share of the misfit of other presses that their numbers have to explain. Where tips stick and
slip it is 0.84; without friction one number explains less than 0.02 of 254 displacements."""


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
        field: The fields, with V ways of variation of sensors, and behind them the way in which
            presses vary, if they do; V = 0 for a training with few sensors.
        clues: Clues of rest layouts.
        slopes: (1 + CLUES, V) from the clues of a rest layout to the expected z.
        covariance: (V, V) of z about its expectation.
    """

    field: Field
    clues: Clues
    slopes: Array
    covariance: Array

    @classmethod
    def learn(
        cls, contacts: Array, values: Array, sensors: Numbers, rests: Array, pins: int
    ) -> Self:
        """Learn the fields from single presses on S sensors.

        Args:
            contacts: (N, 3) x, y and depth, mm.
            values: (N, Q) displacements on the common layout, px: of ``pins`` pins along x, then
                along y, then other quantities.
            sensors: (N,) number of the sensor of a press, 0 to S - 1.
            rests: (S, 1 + Q) size and deviations of the rest layouts.
            pins: Number of pins.

        Raises:
            UserError: There are fewer than twenty presses.
        """
        ways = min(WAYS, len(rests) // SENSORS_A_WAY)
        z, ridge, pitch = np.zeros((len(rests), 0)), None, PITCH_MM
        if ways:
            ridge, pitch = _RIDGE, _PITCH_MM
            some = slice(None, None, -(-len(contacts) // _MOST))
            rough = Field.learn(contacts[some], values[some], pitch=_ROUGH_MM)
            z = _first_guess(contacts, values - rough(contacts), sensors, len(rests), ways)
            for _ in range(_ROUNDS):
                presses = Presses.of(contacts, values, _shares(z)[sensors])
                parts = presses.fields(contacts, presses.weights(_RIDGE))
                parts = parts.reshape(len(contacts), 1 + ways, -1)
                z = _whitened(_regress(parts, values, sensors, len(rests)))
        shares = _shares(z)[sensors]
        y = press_numbers(contacts, values, shares, pins)
        if y is not None:
            shares, ridge = np.column_stack([shares, _AMPLITUDE * y]), _PRESS_RIDGE
        field = Field.learn(contacts, values, shares, pitch, ridge)
        field = field.turned(np.zeros(field.ways), _AMPLITUDE * np.eye(field.ways))
        clues = Clues.learn(rests)
        field = replace(field, of_sensor=ways)
        if not ways:
            return cls(field, clues, np.zeros((1 + CLUES, 0)), np.zeros((0, 0)))
        seen = clues(rests)
        normal = seen.T @ seen + _SHRINK * np.eye(1 + CLUES)
        slopes = np.asarray(np.linalg.solve(normal, seen.T @ z), dtype=np.float64)
        left = z - seen @ slopes
        covariance: Array = left.T @ left / len(left) + 1e-3 * np.eye(ways)
        return cls(field, clues, slopes, covariance)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the family as arrays by name."""
        return {
            "coefficients": self.field.coefficients,
            "low": self.field.low,
            "step": self.field.step,
            "rests": self.clues.mean,
            "clues": self.clues.axes,
            "numbers": self.slopes,
            "numbers_covariance": self.covariance,
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]], quantities: int) -> Self:
        """Return the family of Q quantities from what ``arrays`` returned."""
        ways = arrays["coefficients"].shape[3] // quantities - 1
        sensors = len(arrays["numbers_covariance"])
        field = Field(arrays["coefficients"], arrays["low"], arrays["step"], ways, sensors)
        clues = Clues(arrays["rests"], arrays["clues"])
        return cls(field, clues, arrays["numbers"], arrays["numbers_covariance"])

    def of_sensor(
        self, rest: Array, contacts: Array | None = None, values: Array | None = None
    ) -> Field:
        """Return the field of one sensor.

        Its ways of variation are the remaining uncertainty, and that of the presses: their numbers
        have standard deviation 1.

        Args:
            rest: (1 + Q,) size and deviations of its rest layout.
            contacts: (N, 3) mm, labelled single presses on it; None where there are none.
            values: (N, Q) displacements of these presses, px.
        """
        ways = len(self.covariance)
        if not ways:
            return self.field
        expected = (self.clues(rest[None]) @ self.slopes)[0]
        precision = np.linalg.inv(self.covariance)
        if contacts is not None and values is not None and len(contacts):
            normal, pull = evidence(self.field.slopes(contacts)[:, 0], values, ways)
            wanted = precision @ expected + pull
            precision = precision + normal
            expected = np.linalg.solve(precision, wanted)
        own = self.field.ways - ways  # the way of the presses stays as it is
        axes = np.zeros((self.field.ways, self.field.ways))
        axes[:ways, :ways] = np.linalg.cholesky(np.linalg.inv(precision))
        axes[ways:, ways:] = np.eye(own)
        return self.field.turned(np.append(expected, np.zeros(own)), axes)


def drag_clue(field: Field, pins: int) -> float:
    """Return how far the skin follows tips that press beside the axis, which friction decides.

    It is the mean motion of all pins away from the axis over their rms motion, 3 mm deep, averaged
    over a circle of 5 mm. On the nominal dome it is -0.29 without friction, 0.31 at a coefficient
    of 0.5 and 0.51 at 1; of ten instances at 0.5 it is 0.18 to 0.41.

    Args:
        field: Field of one contact.
        pins: Number of pins; the first quantities are their motions along x, the next along y.
    """
    turns = 2 * np.pi * np.arange(_CIRCLE) / _CIRCLE
    away = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    moved = field(np.column_stack([_CLUE_MM[0] * away, np.full(_CIRCLE, _CLUE_MM[1])]))
    x, y = moved[:, :pins], moved[:, pins : 2 * pins]
    mean = np.stack([x.mean(axis=1), y.mean(axis=1)], axis=1)
    size = np.sqrt((x**2 + y**2).mean(axis=1))
    return float(((mean * away).sum(axis=1) / np.maximum(size, 1e-9)).mean())


def press_numbers(contacts: Array, values: Array, shares: Array, pins: int) -> Array | None:
    """Return (N,) numbers y by which presses differ, of mean 0 and variance 1; None: they do not.

    Friction pulls the skin along the way on which a tip beside the apex would slide, which leads
    away from the axis. So y begins as the mean motion of all pins along that way beyond the mean
    field, and is then learned in turns with the field that it multiplies. Presses from which the
    fields were not learned tell whether y explains enough.

    Args:
        contacts: (N, 3) x, y and depth, mm.
        values: (N, Q) displacements on the common layout, px.
        shares: (N, 1 + V) shares of the mean and of the ways of sensors in the field of a press.
        pins: Number of pins; the first columns of the values are their x, the next their y.
    """
    step = max(2, -(-len(contacts) // _MOST))
    learned = np.arange(len(contacts)) % step == 0
    if np.count_nonzero(learned) < FEWEST:
        return None

    def fields(of_press: Array, ridge: float) -> Array:
        presses = Presses.of(contacts[learned], values[learned], of_press[learned])
        parts = presses.fields(contacts, presses.weights(ridge))
        return parts.reshape(len(contacts), of_press.shape[1], -1)

    known = contacts[learned], values[learned], shares[learned]
    left = values - np.einsum("nv,nvq->nq", shares, fields(shares, _best_ridge(*known)))
    moved = np.stack([left[:, :pins].mean(axis=1), left[:, pins : 2 * pins].mean(axis=1)], axis=1)
    away = contacts[:, :2] / np.maximum(np.hypot(*contacts[:, :2].T), 1e-6)[:, None]
    y = (moved * away).sum(axis=1) / np.maximum(np.hypot(*contacts[:, :2].T) * contacts[:, 2], 1.0)
    before = float((left[~learned] ** 2).sum())
    for _ in range(_PRESS_ROUNDS):
        y = _whitened(y[:, None])[:, 0]
        parts = fields(np.column_stack([shares, _AMPLITUDE * y]), _PRESS_RIDGE)
        way = _AMPLITUDE * parts[:, -1]
        left = values - np.einsum("nv,nvq->nq", shares, parts[:, :-1])
        y = (way * left).sum(axis=1) / ((way**2).sum(axis=1) + _NOISE_PX**2)
    after = float(((left - y[:, None] * way)[~learned] ** 2).sum())
    return _whitened(y[:, None])[:, 0] if after < (1 - _PRESS_SHARE) * before else None


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
        normal, pull = evidence(scaled[rows], values[rows], scaled.shape[1] - 1)
        fields.append(np.linalg.solve(normal + np.eye(len(normal)), pull))
    return np.array(fields)


def evidence(parts: Array, values: Array, ways: int) -> tuple[Array, Array]:
    """Return the information of presses on z of their sensor, (V, V), and its product with z, (V,).

    The number of a press is not known: what its way could explain tells nothing of the sensor.

    Args:
        parts: (N, 1 + V, Q) mean and ways of variation at the presses; (N, 2 + V, Q) with the way
            of the presses.
        values: (N, Q) displacements, px.
        ways: V.
    """
    left = (values - parts[:, 0]) / _NOISE_PX
    of_sensor, of_press = parts[:, 1 : 1 + ways] / _NOISE_PX, parts[:, 1 + ways :] / _NOISE_PX
    if of_press.size:  # Woodbury: (1 + p p')^-1 = 1 - p p' / (1 + p' p)
        size = 1.0 + (of_press**2).sum(axis=2)
        onto = of_press / np.sqrt(size)[..., None]
        normal = np.einsum("nvq,nwq->vw", of_sensor, of_sensor)
        along = np.einsum("nvq,nq->nv", of_sensor, onto[:, 0])
        pull = np.einsum("nvq,nq->v", of_sensor, left)
        return normal - along.T @ along, pull - along.T @ (left * onto[:, 0]).sum(axis=1)
    flat = of_sensor.transpose(1, 0, 2).reshape(ways, -1)
    return flat @ flat.T, flat @ left.reshape(-1)


def _shares(z: Array) -> Array:
    """Return the shares of the mean and of the ways of variation in sensors' fields, (S, 1 + V)."""
    return np.concatenate([np.ones((len(z), 1)), _AMPLITUDE * z], axis=1)


def _whitened(z: Array) -> Array:
    """Return numbers (S, V), transformed to mean 0 and unit covariance over the sensors."""
    centred = z - z.mean(axis=0)
    covariance = centred.T @ centred / len(z) + 1e-9 * np.eye(z.shape[1])
    out: Array = np.linalg.solve(np.linalg.cholesky(covariance), centred.T).T
    return out


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
        ways: V, the number of ways in which the field varies.
        of_sensor: Number of these, the first, in which sensors of one make vary; presses vary in
            the others.
    """

    coefficients: Lattice
    low: Array
    step: Array
    ways: int = 0
    of_sensor: int = 0

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

    def residual(self, contacts: Array, values: Array) -> Array:
        """Return what the field leaves of presses, (N, Q), with the numbers of each fitted to it.

        Args:
            contacts: (N, 3) x, y and depth, mm.
            values: (N, Q) values, px.
        """
        parts = self.slopes(contacts)[:, 0]
        left: Array = values - parts[:, 0]
        ways = parts[:, 1:]
        normal = ways @ ways.transpose(0, 2, 1) + _NOISE_PX**2 * np.eye(self.ways)
        numbers = np.linalg.solve(normal, ways @ left[..., None])
        return left - (ways.transpose(0, 2, 1) @ numbers)[..., 0]

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
        turned = np.ascontiguousarray(mixed).reshape(*knots, -1)
        return replace(self, coefficients=turned, ways=axes.shape[1])

    def correlated(self, contacts: int, motions: int) -> Array:
        """Return (V + R,) how many displacements err together beyond the noise, by nuisance.

        Args:
            contacts: Number of contacts that are fitted.
            motions: R, the number of motions of the image.
        """
        sensors = CORRELATED if contacts < 2 else CROWDED
        counts = self.of_sensor, self.ways - self.of_sensor, motions
        return np.repeat([sensors, CORRELATED, 1.0], counts)


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
