"""Domes of sensor instances between those that were computed, and trainings on many instances.

Axisymmetric fields were computed for nine domes, three stiffness ratios times three skins, the
middle one being nominal. The file that ships holds the differences of the other eight from it. A
dome between them is the nominal table plus differences, quadratic in log ratio and in log skin:

    T(x, y) = T(0, 0) + sum_ij L_i(x) L_j(y) (T_ij - T(0, 0)),      i, j in -1, 0, 1

with x, y in -1..1 from ``dome_of`` and Lagrange's polynomials L. So x = y = 0 gives exactly the
nominal table. How far instances differ is said in ``tolerances``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import Scene
from tactibench_sim.dome import TableMechanics
from tactibench_sim.sensor import SimulatedSensor
from tactibench_sim.tables import Table, Tables, digest_of, shape_name, shipped_file
from tactibench_sim.tolerances import RATIO_FACTOR, RESERVED, SKIN_FACTOR, Tolerances, dome_of

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
FILE = "domes.npz"
QUANTUM = 1e-4
"""Step, mm and rad: the fields' differences are stored as whole multiples of it."""
KEPT = 64
"""Number of domes that stay in memory, 7 MB each with their mechanics; others are made again when
needed."""
STREAM = 9
"""Stream of random numbers that choose the instance of a press. It differs from those of the noise
and of the fitted sensors (7 and 8)."""


def tables_between(nominal: Tables, x: float, y: float, **description: Any) -> Tables:
    """Return the tables of the dome at (x, y) of ``dome_of``, on the grid of the nominal ones.

    The corrections for the rim and for pairs are those of the nominal dome: they are small beside
    the single fields, and how another dome changes them was not computed.

    Args:
        nominal: The tables of the nominal dome.
        x: Logarithm of the stiffness ratio, -1..1.
        y: Logarithm of the skin's thickness, -1..1.
        **description: Further parameters that describe the dome.
    """
    if (x, y) == (0.0, 0.0):
        return nominal
    file = shipped_file(FILE)
    weight = np.outer(_lagrange(x), _lagrange(y))
    by_radius = {}
    for radius, table in nominal.by_radius.items():
        fields = {}
        for name, field in table.fields.items():
            # (3, 3, D, T) by ratio, skin, depth and angle; the nominal dome's, at [1, 1], are 0
            stored = file.arrays[f"{shape_name(radius)}_{name}"]
            change = np.tensordot(weight, stored if name == "force" else QUANTUM * stored, 2)
            change = CubicSpline(file.arrays["delta"], change, axis=0)(table.delta)
            if name != "force":
                change = CubicSpline(file.arrays["polar"], change, axis=1)(table.polar)
            fields[name] = field + change
        by_radius[radius] = Table(radius, table.delta, table.polar, fields)
    dome = dict(nominal.parameters["dome"])
    dome["stiffness_ratio"] *= RATIO_FACTOR**x
    dome["skin"] *= SKIN_FACTOR**y
    parameters = {**nominal.parameters, "dome": dome, "between": file.digest, **description}
    identity = json.dumps({**parameters, "nominal": nominal.digest}, sort_keys=True)
    return Tables(parameters, digest_of({}, identity), by_radius, nominal.corrections)


@lru_cache(maxsize=KEPT)
def instance_tables(nominal: Tables, instance: int) -> Tables:
    """Return the tables of instance N of the nominal dome; instance 0 has ``nominal`` itself."""
    return tables_between(nominal, *dome_of(instance), instance=instance)


@lru_cache(maxsize=KEPT)
def instance_mechanics(tier: str, tables: Tables) -> TableMechanics:
    """Return the mechanics of an instance's tables, the same object for all sensors that need it.

    A run opens a sensor for every 250 presses, and most of the time of making an instance is spent
    here.

    Raises:
        UserError: ``tier`` is no tier.
    """
    return TableMechanics(tables, tier)


def _lagrange(x: float) -> Array:
    """Return the (3,) weights of nodes -1, 0, 1."""
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2])


class TrainingInstances:
    """The sensor instances of a training, each made when the first press needs it.

    At most ``KEPT`` of them stay in memory; the rest frames of all of them do.
    """

    def __init__(
        self,
        make: Callable[..., SimulatedSensor],
        seed: np.random.SeedSequence,
        count: int,
    ) -> None:
        """Prepare the instances; none is made yet.

        Args:
            make: Makes the sensor of an ``instance``.
            seed: Seed of the sensor.
            count: Number of instances.
        """
        self.count = count
        self._seed = seed
        self._rests: dict[int, Images] = {}
        self._sensor = lru_cache(maxsize=KEPT)(lambda number: make(instance=number))

    def number_of(self, press: int) -> int:
        """Return the number of the instance on which a press is made, 10 or more.

        It depends on the seed of the sensor and the number of the press alone.
        """
        key = (*self._seed.spawn_key, STREAM, press)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed.entropy, spawn_key=key))
        return RESERVED + int(rng.integers(self.count))

    def rest_of(self, press: int) -> Images:
        """Return the rest frame of a press's instance, the same array for all its presses."""
        number = self.number_of(press)
        if number not in self._rests:
            self._rests[number] = self._sensor(number).rest().image
        return self._rests[number]

    def images(self, scenes: Sequence[Scene], first: int, states: npt.NDArray[np.uint64]) -> Images:
        """Return the images of consecutive presses, uint8.

        Args:
            scenes: S scenes.
            first: Number of the first press.
            states: (S, 4) states of the noise.

        Raises:
            UserError: A scene cannot be pressed.
        """
        numbers = np.array([self.number_of(first + k) for k in range(len(scenes))])
        out: Images | None = None
        for number in np.unique(numbers).tolist():
            rows, sensor = np.flatnonzero(numbers == number).tolist(), self._sensor(number)
            points = sensor.points([scenes[row] for row in rows])
            images = sensor.renderer.frames(points, states[rows])
            if out is None:
                out = np.empty((len(scenes), *images.shape[1:]), dtype=np.uint8)
            out[rows] = images
        assert out is not None  # noqa: S101 - a batch holds a press
        return out

    def describe(self) -> dict[str, Any]:
        """Return all that determines the instances."""
        return {
            "count": self.count,
            "numbers": [RESERVED, RESERVED + self.count - 1],
            "tolerances": asdict(Tolerances()),
            "domes": shipped_file(FILE).digest,
        }
