"""A few test frames that stay with a run, so that its pictures need neither sensor nor model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.channels import holds_channels
from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.frames import spread
from tactibench.plugins import Model
from tactibench.records import Arrays
from tactibench.run.predict import blinded

EXAMPLES = 24
"""Test frames that stay with a run: enough for its pictures."""
CHANNELS = 6
"""Channels of a layer that are stored: those that vary most over the frame."""
FEATURE = "feature."
"""Begins the names of arrays of features."""


def example_arrays(
    frames: Sequence[Frame],
    truth: Sequence[Answer],
    model: Model | None,
    rows: Sequence[int] | None = None,
) -> Arrays:
    """Return frames of a test, and the features of the model's layers for one of them.

    Args:
        frames: Frames of the whole test.
        truth: True answer to every frame.
        model: Model whose features are stored, if it shows them; None for no features.
        rows: Rows of the frames that are stored; None: rows spread over all frames.

    Returns:
        index (E,) and images or channels (E, ...). With features also features_row (), the first
        frame with the most contacts, and ``feature.<number>.<channels>.<layer>`` (<= 6, H, W)
        float16.

    Raises:
        UserError: The features of a layer are no finite (C, H, W) array.
    """
    rows = spread(range(len(frames)), EXAMPLES) if rows is None else tuple(rows)
    name = "channels" if holds_channels(frames) else "images"
    arrays: Arrays = {
        "index": np.array(rows, dtype=np.int64),
        name: np.stack([frames[row].signal for row in rows]),
    }
    if model is not None:
        row = max(rows, key=lambda row: (_contacts(truth[row]), -row))
        if features := model.features(blinded(frames[row])):
            arrays["features_row"] = np.array(row, dtype=np.int64)
            arrays |= pack_features(features)
    return arrays


def pack_features(features: Mapping[str, npt.NDArray[Any]]) -> Arrays:
    """Return the channels of every layer that vary most, in the layers' order.

    Args:
        features: Name of a layer -> (C, H, W) values.

    Returns:
        ``feature.<number>.<channels>.<layer>`` -> (<= 6, H, W) float16.

    Raises:
        UserError: The features of a layer are no finite (C, H, W) array.
    """
    arrays = {}
    for k, (name, values) in enumerate(features.items()):
        if values.ndim != 3 or not np.isfinite(values).all():
            raise UserError(
                f"the model shows features {name!r} of shape {values.shape}; they must be finite "
                "and of shape (channels, rows, columns): fix the model."
            )
        varied = np.argsort(-values.std(axis=(1, 2)), kind="stable")[:CHANNELS]
        arrays[f"{FEATURE}{k:03d}.{len(values)}.{name}"] = values[varied].astype(np.float16)
    return arrays


def unpack_features(arrays: Arrays) -> list[tuple[str, int, npt.NDArray[Any]]]:
    """Return name, number of channels and stored channels (<= 6, H, W) of every layer.

    This undoes ``pack_features``.
    """
    features = []
    for key in sorted(name for name in arrays if name.startswith(FEATURE)):
        _, _, channels, name = key.split(".", 3)
        features.append((name, int(channels), arrays[key].astype(np.float64)))
    return features


def _contacts(answer: Answer) -> int:
    return len(answer) if isinstance(answer, Contacts) else 1
