"""A few test frames that stay with a run, so that its pictures need neither sensor nor model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.frames.source import spread
from tactibench.plugins.base import Model
from tactibench.records.store import Arrays
from tactibench.run.predict import blinded

EXAMPLES = 24
CHANNELS = 6
"""Channels of a layer that are kept: those that vary most over the frame."""
FEATURE = "feature."


def example_arrays(
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    model: Model | None,
    rows: Sequence[int] | None = None,
) -> Arrays:
    """index (E,), images (E, ...) of frames spread over all, or of ``rows``; features of one, if
    the model shows them: features_row (), and ``feature.<number>.<channels>.<layer>`` (<= 6, H, W)
    float16.

    That one is the first with the most contacts. Raises UserError for features that are no finite
    (C, H, W).
    """
    rows = spread(range(len(frames)), EXAMPLES) if rows is None else tuple(rows)
    arrays: Arrays = {
        "index": np.array(rows, dtype=np.int64),
        "images": np.stack([frames[row].image for row in rows]),
    }
    if model is not None:
        row = max(rows, key=lambda row: (_contacts(truth[row]), -row))
        features = model.features(blinded(frames[row]))
        if features:
            arrays["features_row"] = np.array(row, dtype=np.int64)
            arrays |= packed_features(features)
    return arrays


def packed_features(features: Mapping[str, npt.NDArray[Any]]) -> Arrays:
    """The most varied channels of every layer, in the layers' order."""
    packed = {}
    for k, (name, values) in enumerate(features.items()):
        if values.ndim != 3 or not np.isfinite(values).all():
            raise UserError(
                f"the model shows features {name!r} of shape {values.shape}; they must be finite "
                "and of shape (channels, rows, columns): mend the model."
            )
        most = np.argsort(-values.std(axis=(1, 2)), kind="stable")[:CHANNELS]
        packed[f"{FEATURE}{k:03d}.{len(values)}.{name}"] = values[most].astype(np.float16)
    return packed


def unpacked_features(arrays: Arrays) -> list[tuple[str, int, npt.NDArray[Any]]]:
    """Layer, how many channels it has, and (<= 6, H, W) of them; the inverse of the above."""
    found = []
    for key in sorted(name for name in arrays if name.startswith(FEATURE)):
        _, _, channels, name = key.split(".", 3)
        found.append((name, int(channels), arrays[key].astype(np.float64)))
    return found


def _contacts(answer: Answer) -> int:
    return len(answer) if isinstance(answer, Contacts) else 1
