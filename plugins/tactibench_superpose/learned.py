"""The weights of ``superpose``: the results of a training, and their arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench.superposition import FieldFamily, NeighbourLaw, Residual, Spread
from tactibench_superpose.detect import ModelError

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Learned:
    """All results of a training.

    Attributes:
        family: Fields of single contacts on every sensor.
        rest_image: (side, side) gray, the first training sensor at rest, for frames that carry no
            rest image. Its pins are the layout of all sensors.
        weight: (Q,) 1 / variance of the displacements, 1 / px^2.
        model_error: The usual residual of presses with several contacts.
        law: How contacts shift their neighbours.
        residual: What the law leaves of pairs.
        spread: Standard deviations of answers.
    """

    family: FieldFamily
    rest_image: Image
    weight: Array
    model_error: ModelError
    law: NeighbourLaw
    residual: Residual
    spread: Spread

    def shift(self, equivalents: Array) -> Array:
        """Return the (1, K, 3) shifts, mm, from equivalents (1, K, 3) to their contacts."""
        return self.law.shift(equivalents) + self.residual.shift(equivalents)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all results as arrays by name."""
        residual = self.residual
        return {
            **self.family.arrays(),
            "weight": self.weight,
            "still": self.rest_image,
            "pair": self.law.pair,
            "crowd": self.law.crowd,
            "pairs": residual.features,
            "pairs_along": residual.along,
            "pairs_across": residual.across,
            "pairs_length": np.array(residual.length),
            "spread": self.spread.terms,
            "unexplained": self.model_error.covariance,
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """Return the results from what ``arrays`` returned."""
        weight = arrays["weight"]
        pairs = arrays["pairs"], arrays["pairs_along"], arrays["pairs_across"]
        return cls(
            FieldFamily.of(arrays, len(weight)),
            arrays["still"],
            weight,
            ModelError(arrays["unexplained"], np.sqrt(weight)),
            NeighbourLaw(arrays["pair"], arrays["crowd"]),
            Residual(*pairs, float(arrays["pairs_length"])),
            Spread(arrays["spread"]),
        )
