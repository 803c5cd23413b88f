"""The heatmap, scored as what it claims to be: the deformed surface.

An encoder draws every contact in one fixed shape, so that even its map of the true contacts differs
from the surface. This floor belongs to the encoder; what a model adds is the excess over it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, FloatArray, Grid
from tactibench.metrics.spec import MetricSpec, Rows, Sample, by_kind, mean_metric
from tactibench.metrics.trials import Trials
from tactibench.plugins import Encoder
from tactibench.stats import Estimate, mean_interval, rms_interval

BATCH = 100
"""Frames whose maps are drawn at once."""


def surface_mean_squares(trials: Trials) -> Sample:
    """Return the mean over cells of (map * max_depth - surface)^2, one value per frame, mm^2."""
    if trials.maps is None or trials.surface is None:
        return Sample(np.empty(0), np.empty(0, dtype=np.intp))
    values = [
        _mean_square(m, s, trials.max_depth)
        for m, s in zip(trials.maps, trials.surface, strict=True)
    ]
    return Sample(np.array(values, dtype=np.float64), np.arange(len(trials)))


def _mean_square(
    heat: npt.NDArray[np.number], surface: npt.NDArray[np.number], deep: float
) -> float:
    return float(np.mean((heat.astype(np.float64) * deep - surface) ** 2))


def surface_floor(
    encoder: Encoder,
    truth: Sequence[Contacts],
    surfaces: npt.NDArray[np.number],
    grid: Grid,
    max_depth: float,
) -> FloatArray:
    """Return the (N,) ``surface_mean_squares`` of the true contacts, drawn by an encoder, mm^2.

    Args:
        encoder: Encoder whose first map stands for the surface.
        truth: True contacts of N frames.
        surfaces: (N, H, W) true inward displacement of the skin, mm.
        grid: Grid of the maps and of the surfaces.
        max_depth: Depth of heat 1, mm.
    """
    values: list[float] = []
    for start in range(0, len(truth), BATCH):
        maps = encoder.encode_batch(truth[start : start + BATCH], grid)[:, 0]
        batch = surfaces[start : start + BATCH]
        values += [_mean_square(m, s, max_depth) for m, s in zip(maps, batch, strict=True)]
    return np.array(values, dtype=np.float64)


def floor_mean_squares(trials: Trials) -> Sample:
    """Return the ``surface_floor`` of every frame, mm^2; no values where there is none."""
    if trials.floor is None:
        return Sample(np.empty(0), np.empty(0, dtype=np.intp))
    return Sample(trials.floor, np.arange(len(trials)))


def surface_excess(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield ``surface_rmse_mm`` minus its floor; the interval follows by linearising the roots."""
    squares, floor = surface_mean_squares(trials).values, floor_mean_squares(trials).values
    for name, member in by_kind(trials).items():
        if not len(squares) or not len(floor) or not member.any():
            yield name, Estimate.nothing()
            continue
        press = trials.press[member]
        yield name, _difference_of_roots(squares[member], floor[member], press, trials.level)


def _difference_of_roots(
    squares: FloatArray, others: FloatArray, press: npt.NDArray[np.generic], level: float
) -> Estimate:
    root, other = (math.sqrt(float(values.mean())) for values in (squares, others))
    # d sqrt(m) = d m / (2 sqrt(m)); a root of 0 has nothing to scatter
    linear = sum(
        sign * (values - r**2) / (2 * r)
        for sign, values, r in ((1, squares, root), (-1, others, other))
        if r > 0
    )
    spread = mean_interval(linear + np.zeros(len(squares)), press, level=level)
    low, high = (None if end is None else root - other + end for end in (spread.low, spread.high))
    return Estimate(root - other, low, high, spread.n, spread.clusters)


SPECS = (
    mean_metric(
        "surface_rmse_mm",
        "mm",
        "lower",
        "sqrt(mean over cells and frames of "
        "(heatmap * max_depth - inward displacement of the skin)^2)",
        surface_mean_squares,
        rms_interval,
        root=True,
    ),
    mean_metric(
        "surface_floor_mm",
        "mm",
        "none",
        "surface_rmse_mm of the true contacts, drawn by the encoder of the model",
        floor_mean_squares,
        rms_interval,
        root=True,
    ),
    MetricSpec(
        "surface_excess_mm",
        "mm",
        "lower",
        "surface_rmse_mm - surface_floor_mm",
        surface_excess,
    ),
)
