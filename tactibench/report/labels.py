"""Names of metrics in heads of tables and in sentences."""

from __future__ import annotations

from tactibench.metrics import FAMILIES, find_metric

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
    return metric in FAMILIES and find_metric(metric).unit == "share"


def named(metric: str, unit: str) -> str:
    """Return the name of a metric with its unit, such as "distance error, mm"."""
    shown = UNITS.get(unit, unit)
    return f"{NAMES.get(metric, metric)}, {shown}" if shown else NAMES.get(metric, metric)
