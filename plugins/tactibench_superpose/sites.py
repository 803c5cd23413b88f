"""The model ``superpose`` where named places are asked for: fields of places that add up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.training import SiteModel

Array = npt.NDArray[np.float64]

_OWN = 3.0
"""Weight of every channel's own noise beside the noise that channels share, as the residuals of the
training trials show it: these are fewer than the channels."""


class SuperposeSites(SiteModel):
    """Least squares of squashed fields of the places, in the noise of the training trials."""

    name = "superpose"
    adds = True

    def learn(
        self,
        inputs: npt.NDArray[np.float32],
        touched: npt.NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> dict[str, npt.NDArray[Any]]:
        """Return the weights (C, K) of the generalised least squares estimate."""
        del rng
        fields = np.linalg.lstsq(touched.astype(np.float64), inputs, rcond=None)[0]
        left = inputs - touched @ fields
        own = _OWN * (left.var(axis=0) + 1e-3)
        shared = left / len(left) ** 0.5
        # The inverse of diag(own) + shared' shared by the matrix inversion lemma.
        inner = np.eye(len(left)) + (shared / own) @ shared.T
        whitened = fields / own
        whitened -= np.linalg.solve(inner, shared @ whitened.T).T @ (shared / own)
        return {"weight": np.linalg.lstsq(whitened @ fields.T, whitened, rcond=None)[0].T}

    def scores(
        self, learned: Mapping[str, npt.NDArray[Any]], inputs: npt.NDArray[np.float32]
    ) -> Array:
        """Return how strongly each place is touched, (N, K)."""
        scores: Array = inputs @ learned["weight"]
        return scores
