"""Where a signal that grows with depth begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactibench_tactip.geometry.frames import Array

POWERS = np.arange(1.0, 2.01, 0.1)
"""Between the displacement of a pin under the tip (1) and a Hertzian force (1.5) and beyond."""
GRID_MM = 0.002


@dataclass(frozen=True)
class Onset:
    """at_mm: where the signal begins. power: of its growth. misfit: rms over the largest signal."""

    at_mm: float
    power: float
    misfit: float


def projections(images: Array, rest: Array) -> Array:
    """(N,) share of the last image's change that every image shows.

    q_i = <I_i - I_0, t> / <t, t> with t = I_N - I_0 without its mean: every pixel counts as much as
    it changes, so that noise of a frame adds little, and a change of brightness nothing.
    """
    change = (images - rest).reshape(len(images), -1)
    change = change - change.mean(axis=1, keepdims=True)
    template = change[-1]
    found: Array = change @ template / max(float(template @ template), 1e-12)
    return found


def onset(depths: Array, signal: Array) -> Onset:
    """The best q = a max(0, s - s0)^p, least squares; depths s (N,) mm rising."""
    last = float(depths[-1])
    starts = np.arange(float(depths[0]), last - 0.1, GRID_MM)
    best = (np.inf, float(depths[0]), 1.0)
    for power in POWERS:
        base = np.maximum(0.0, depths[None, :] - starts[:, None]) ** power
        scale = base @ signal / np.maximum((base**2).sum(axis=1), 1e-12)
        errors = ((scale[:, None] * base - signal) ** 2).sum(axis=1)
        k = int(np.argmin(errors))
        if errors[k] < best[0]:
            best = (float(errors[k]), float(starts[k]), float(power))
    top = float(np.abs(signal).max())
    return Onset(best[1], best[2], float(np.sqrt(best[0] / len(signal))) / max(top, 1e-12))
