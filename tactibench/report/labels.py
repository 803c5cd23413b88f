"""Numbers as text, and the names of metrics: the same in a terminal, a table and a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial

from tactibench.metrics import all_metrics, find_metric

Format = Callable[[float], str]


def number(value: float, decimals: int) -> str:
    """Return a value with fixed decimals; one that would read as zero keeps one digit."""
    if value and abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.0e}"
    return f"{value:,.{decimals}f}"


def fixed(decimals: int) -> Format:
    """Return the format with this number of decimals."""
    return partial(number, decimals=decimals)


def significant(value: float, digits: int = 3) -> str:
    """Return a value with at least ``digits`` significant digits: 0.0123, 6.12, 1,234."""
    if not value:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"


def general(value: float) -> str:
    """Return a value with three significant digits, without trailing zeros: 0.21, 6.5, 64."""
    return f"{value:.3g}"


def scaled(value: float) -> str:
    """Return a large count with its prefix: 950, 12.3 k, 1.93 M, 2.1 G."""
    for size, prefix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if abs(value) >= size:
            return f"{value / size:.3g}{prefix}"
    return f"{value:.4g}"


def duration(seconds: float) -> str:
    """Return a time in words, such as "0.4 s", "38 s", "4 min 5 s" or "1 h 2 min"."""
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def span(counts: Iterable[int]) -> str:
    """Return the range of counts: "1,000", or "998 to 1,000" where they differ."""
    numbers = list(counts)
    low, high = min(numbers, default=0), max(numbers, default=0)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 seed", "3 seeds"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


HEADS = {
    "coverage": "coverage, %",
    "depth_mae_mm": "depth, mm",
    "distance_mae_mm": "error, mm",
    "distance_penalised_mm": "penalised, mm",
    "mae_mm": "MAE, mm",
    "missed": "missed, %",
    "orientation_mae_deg": "turn, deg",
    "position_mean_mm": "position, mm",
    "r2": "R2",
    "resolved": "resolved, %",
    "rmse_mm": "RMSE, mm",
    "tilt_mae_deg": "tilt, deg",
}
"""Heads of columns."""

NAMES = {
    "catch_resolved": "single presses seen as two",
    "coverage": "coverage",
    "d_prime": "d' of one against two",
    "depth_mae_minus_published_mm": "depth error minus released",
    "depth_mae_minus_published_p": "p of that",
    "depth_mae_mm": "depth error",
    "distance_mae_mm": "distance error",
    "distance_penalised_mm": "penalised distance error",
    "doubles_at": "value at which the error doubles",
    "error_ratio": "error / error of the easy case",
    "false_per_1000": "false contacts per 1,000 empty frames",
    "gospa1_mm": "GOSPA, p = 1",
    "gospa2_mm": "GOSPA, p = 2",
    "mae_mm": "MAE",
    "missed": "missed contacts",
    "not_finite": "frames answered with NaN or infinity",
    "orientation_mae_deg": "orientation error of the pair",
    "ospa_mm": "error a contact (OSPA, p = 1)",
    "position_mean_mm": "position error",
    "position_ungated_mm": "position error without gate",
    "r2": "R2",
    "raised": "frames on which the model raised an exception",
    "relative_depth_mae_mm": "relative depth error",
    "resolved": "resolved as two",
    "rmse_mm": "RMSE",
    "rmse_over_bound": "RMSE / Cramer-Rao bound",
    "rmse_pooled_mm": "RMSE pooled over axes",
    "spurious": "spurious contacts per frame",
    "surface_excess_mm": "surface RMSE above the floor",
    "surface_floor_mm": "surface floor of the encoder",
    "surface_rmse_mm": "surface RMSE of the heatmap",
    "threshold_mm": "two-point threshold (75 %)",
    "limit_mm": "two-point limit of the noise",
    "tilt_mae_deg": "tilt error",
    "tilt_mae_minus_published_deg": "tilt error minus released",
    "tilt_mae_minus_published_p": "p of that",
    "worst_ratio": "largest error / error of the easy case",
}
"""Names in sentences and lists."""

UNITS = {"share": "%", "per frame": ""}
"""Units as they are written behind a name; "spurious per frame" holds its own."""


def is_share(metric: str) -> bool:
    """Return whether a metric lies in 0..1 and is shown in per cent."""
    return metric in all_metrics() and find_metric(metric).unit == "share"


def named(metric: str, unit: str) -> str:
    """Return the name of a metric with its unit, such as "distance error, mm"."""
    shown = UNITS.get(unit, unit)
    return f"{NAMES.get(metric, metric)}, {shown}" if shown else NAMES.get(metric, metric)
