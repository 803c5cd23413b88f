"""The encoder ``axes``: one contact as a profile along x, a profile along y and a depth.

Source: SimCC (Li et al., "SimCC: A Simple Coordinate Classification Perspective for Human Pose
Estimation", ECCV 2022): a coordinate is read from a Gaussian over the cells of its own axis. Here
the profiles are maps, the same in every row or every column, so that a network that draws maps can
learn them and the mean over them is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.encoder import MapEncoder, MapStack, relative_depth
from tactibench_heatmaps.peaks import FloatArray, split_contacts

_STEPS = 3
"""Gauss-Newton steps from the highest cell."""
_RIDGE = 1e-12
"""Keeps a flat profile, which has no peak, from dividing by zero."""


class Axes(MapEncoder):
    """At most one contact <-> (3, H, W): its profiles along x and y, and d / max_depth everywhere.

    Profiles are Gaussians of height 1, read by least squares over ``window`` cells. There is no
    contact where the lower of the two peaks is below the threshold; otherwise its height, cut to 1,
    is the score. Depth is the mean of its map. Without a contact all maps are 0.

    The parameters are declared in ``hooks``. ``tolerance`` holds for their defaults on a 64 x 64
    grid of 0.4 mm pitch and any depth; two contacts are never told apart.
    """

    channels = 3
    separation = float("inf")
    tolerance = 0.002

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        sigma: float = 0.8,
        threshold: float = 0.3,
        window: int = 11,
    ) -> None:
        self.max_depth = max_depth
        self.sigma = sigma
        self.threshold = threshold
        self.window = window

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 3, H, W) float32 maps.

        Raises:
            UserError: A frame has more than one contact, or a depth is not between 0 and
                ``max_depth``.
        """
        out = np.zeros((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        counts = np.array([len(c) for c in contacts], dtype=np.intp)
        if counts.size and counts.max() > 1:
            raise UserError(
                f"encoder 'axes' shows one contact a frame, but a frame holds {counts.max()}; take "
                "encoder 'hertz', or train in regime 'single'."
            )
        pressed = np.flatnonzero(counts)
        if len(pressed):
            x, y = grid.axes()
            xy = np.concatenate([c.xy for c in contacts])
            depth = np.concatenate([c.depth for c in contacts])
            out[pressed, 0] = self._profile(x - xy[:, :1])[:, None, :]
            out[pressed, 1] = self._profile(y - xy[:, 1:])[:, :, None]
            out[pressed, 2] = relative_depth(depth, self.max_depth)[:, None, None]
        return out

    def _profile(self, away: FloatArray) -> FloatArray:
        profile: FloatArray = np.exp(-0.5 * (away / self.sigma) ** 2)
        return profile

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        variance = (self.sigma / grid.pitch) ** 2
        column, high = _peak(stack[:, 0].mean(axis=1), variance, self.window)
        row, wide = _peak(stack[:, 1].mean(axis=2), variance, self.window)
        heat = np.minimum(high, wide)
        present = heat >= self.threshold
        depth = self.max_depth * stack[:, 2].mean(axis=(1, 2))[present].astype(np.float64)
        xy = grid.xy(row[present], column[present])
        return split_contacts(present.astype(np.int64), xy, depth, np.minimum(heat[present], 1.0))


def _peak(
    profiles: npt.NDArray[Any], variance: float, window: int
) -> tuple[FloatArray, FloatArray]:
    """Return the (N,) places, cells, where profiles are highest, and their (N,) heights.

    It is Gauss-Newton on heat for the parabola l(u) = t . [1, u, u^2] of log-heat, as in
    ``least-squares`` of ``peaks``. Where the parabola is not concave or strays, the result is the
    highest cell. A flat profile has the height 0.

    Args:
        profiles: (N, L) profiles.
        variance: Variance of the Gaussians, cells^2.
        window: Cells of the fit, odd.
    """
    rows = np.arange(len(profiles))[:, None]
    size = profiles.shape[1]
    cell = profiles.argmax(axis=1)
    heat = profiles[rows[:, 0], cell]
    u = np.arange(window) - window // 2
    at = cell[:, None] + u
    inside = (at >= 0) & (at < size)
    seen = profiles[rows, np.clip(at, 0, size - 1)]
    design = np.stack([np.ones(window), u, u * u], axis=1)
    products = (design[:, :, None] * design[:, None, :]).reshape(window, 9)
    theta = np.zeros((len(profiles), 3))
    theta[:, 0] = start = np.log(np.maximum(heat, 1e-6))
    theta[:, 2] = -0.5 / variance
    for _ in range(_STEPS):
        logs = theta @ design.T
        expected = np.exp(np.minimum(logs, 2.0)) * inside
        target = (expected * (seen + expected * (logs - 1.0))) @ design
        normal = (expected * expected) @ products
        normal[:, ::4] += _RIDGE
        theta = np.linalg.solve(normal.reshape(-1, 3, 3), target[:, :, None])[:, :, 0]
    sharp = np.minimum(theta[:, 2], -1e-9)
    shift = -0.5 * theta[:, 1] / sharp
    rise = theta[:, 0] - sharp * shift * shift
    good = (shift * shift <= max(variance, 1.0)) & (np.abs(rise - start) <= np.log(1.6))
    flat = profiles.max(axis=1) == profiles.min(axis=1)
    height = np.where(good, np.exp(np.where(good, rise, 0.0)), heat)
    return cell + np.where(good, shift, 0.0), np.where(flat, 0.0, height)
