"""Presses spread over many sensor instances, for a model to be trained on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Scene
from tactibench_sim import tolerances
from tactibench_sim.instances import KEPT, TRAINING_RANGES, shipped, training_instance
from tactibench_sim.rendered_sensor import RenderedSensor

Images = npt.NDArray[np.uint8]
STREAM = 9
"""Stream of random numbers that choose the instance of a press. It differs from those of the noise
and of the fitted sensors (7 and 8)."""


class TrainingInstances:
    """The sensor instances of a training, each made when the first press needs it.

    At most ``KEPT`` of them stay in memory; the rest frames of all of them do.
    """

    def __init__(
        self,
        make: Callable[..., RenderedSensor],
        seed: np.random.SeedSequence,
        count: int,
    ) -> None:
        """Prepare the instances; none is made yet.

        Args:
            make: Makes the sensor of an ``instance`` with a version of its ``ranges``.
            seed: Seed of the sensor.
            count: Number of instances.
        """
        self.count = count
        self._seed = seed
        self._rests: dict[int, Images] = {}
        self._sensor = lru_cache(maxsize=KEPT)(
            lambda number: make(instance=number, ranges=TRAINING_RANGES)
        )

    def number_of(self, press: int) -> int:
        """Return the number of the instance on which a press is made, 10 or more.

        It depends on the seed of the sensor and the number of the press alone.
        """
        key = (*self._seed.spawn_key, STREAM, press)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed.entropy, spawn_key=key))
        return training_instance(int(rng.integers(self.count)))

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
            "numbers": [training_instance(0), training_instance(self.count - 1)],
            "ranges": TRAINING_RANGES,
            "tolerances": asdict(tolerances.TOLERANCES),
            "domes": shipped().digest,
        }
