"""Channels of sensors without a camera, as the vectors that models compute with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame
from tactibench.errors import UserError


def holds_channels(frames: Sequence[Frame]) -> bool:
    """Return whether training frames, all of one kind, are float32 channels rather than images."""
    return bool(frames) and frames[0].signal.dtype == np.float32


def channel_vectors(
    frames: Sequence[Frame], *, minus_rest: bool, count: int | None = None
) -> npt.NDArray[np.float32]:
    """Return the channels of N frames, (N, C) float32; an array of taxels is laid out in a row.

    Args:
        frames: Frames of one sensor.
        minus_rest: Whether the channels of the undeformed sensor are subtracted.
        count: C of the frames that a model was trained on; None where these are the training
            frames.

    Raises:
        UserError: A frame has channels of another shape than the first frame or another number than
            those of the training, holds NaN or infinity, or has no rest frame of its shape where
            one is needed.
    """
    rows = []
    if count is not None and frames and frames[0].signal.size != count:
        raise UserError(
            f"the frames have {frames[0].signal.size} channels, but the model was trained on "
            f"{count}; use the sensor that it was trained on."
        )
    for number, frame in enumerate(frames, 1):
        where = f"frame {number} of {len(frames)}"
        if frame.signal.shape != frames[0].signal.shape:
            raise UserError(
                f"{where} has channels of shape {frame.signal.shape}, but the first one "
                f"{frames[0].signal.shape}; take frames of one sensor."
            )
        row = np.asarray(frame.signal, dtype=np.float32)
        if minus_rest:
            if frame.rest is None or frame.rest.shape != row.shape:
                raise UserError(
                    f"{where} has no rest frame of its own shape, but the model learned channels "
                    "less those at rest; use the sensor that it was trained on."
                )
            row = row - np.asarray(frame.rest, dtype=np.float32)
        bad = np.flatnonzero(~np.isfinite(row.ravel()))
        if len(bad):
            raise UserError(
                f"{where} holds no finite number in channel {bad[0] + 1}; leave it out."
            )
        rows.append(row.ravel())
    return np.stack(rows) if rows else np.empty((0, count or 0), dtype=np.float32)
