"""Predictions for the test frames: made once, kept under the identity of the whole run.

A second store, or a run that was stopped while it was timed, does not ask the model again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer
from tactibench.records.answers import unpack_contacts, unpack_plates
from tactibench.records.files import read_checked_arrays, write_checked_arrays

Arrays = dict[str, npt.NDArray[Any]]
MAPS = "maps"


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions for all test frames.

    Attributes:
        arrays: packed answers, as they are stored with a run.
        maps: (N, H, W) first heatmaps; None where the model shows none.
    """

    arrays: Arrays
    maps: npt.NDArray[np.float16] | None = None

    @property
    def map_arrays(self) -> Arrays:
        """Return the heatmaps as they are stored with a run; {} where there are none."""
        return {} if self.maps is None else {MAPS: self.maps}

    def answers(self, kind: str) -> list[Answer | None]:
        """Return the answers, "contacts" or "plate"."""
        unpack = unpack_plates if kind == "plate" else unpack_contacts
        return list(unpack(self.arrays))


def cached_predictions(
    path: Path, weights_hash: str, predict: Callable[[], Predictions], *, fresh: bool
) -> Predictions:
    """Return the kept predictions of these very weights, or make and keep them.

    Args:
        path: of the file in the cache.
        weights_hash: of the model's weights; predictions of other weights are not taken.
        predict: asks the model.
        fresh: whether to ask the model in any case.
    """
    arrays = None if fresh else read_checked_arrays(path, weights_hash)
    if arrays is None:
        predictions = predict()
        write_checked_arrays(path, {**predictions.arrays, **predictions.map_arrays}, weights_hash)
        return predictions
    maps = arrays.pop(MAPS, None)
    return Predictions(arrays, maps)
