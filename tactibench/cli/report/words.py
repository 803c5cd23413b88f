"""Which tables a protocol prints first, and how metrics are called in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Block:
    """A main table. metrics: name -> decimals. groups: its rows, () for all distances.

    compared: whether published rows and other runs follow below the run's own.
    """

    title: str
    metrics: Mapping[str, int]
    groups: tuple[str, ...]
    compared: bool = True


BLOCKS: Mapping[str, tuple[Block, ...]] = {
    "exp1": (
        Block("Error by axis", {"r2": 4, "mae_mm": 4, "rmse_mm": 4}, ("x", "y", "z", "mean")),
    ),
    "exp2": (
        Block(
            "By true distance of the tips, mm",
            {
                "resolved": 0,
                "distance_mae_mm": 3,
                "distance_penalised_mm": 3,
                "orientation_mae_deg": 1,
            },
            (),
            compared=False,
        ),
        Block(
            "All distances",
            {"distance_mae_mm": 3, "distance_penalised_mm": 3, "resolved": 1},
            ("all",),
        ),
    ),
    "exp3": (
        Block(
            "By number of contacts",
            {"position_mean_mm": 3, "depth_mae_mm": 3, "missed": 1},
            ("dual", "triple", "all"),
        ),
    ),
    "surface": (
        Block("Flat plate", {"depth_mae_mm": 4, "tilt_mae_deg": 3, "coverage": 1}, ("all",)),
    ),
    "transfer": (
        Block(
            "By labelled frames of the tested sensor",
            {"depth_mae_mm": 3, "tilt_mae_deg": 2, "coverage": 1},
            ("0", "10", "50", "200"),
        ),
    ),
}
"""Every other metric of a record is listed after these."""

EXPLAIN = {
    "exp1": "Best-scored prediction against the one true contact, no gate.",
    "exp2": "error, turn: over resolved pairs only; penalised: an unresolved pair counts its true "
    "distance, so that no missing contact improves it. n: resolved/all pairs.",
    "exp3": "position, depth: over contacts matched inside the gate; missed: true contacts without "
    "a match. n: matched/true contacts.",
    "stability": "error: in x, y and depth a contact, a missed or false one counts the gate; "
    "doubles at: value at which it is twice that of the easy case.",
    "surface": "depth, tilt: over answered frames; coverage: answered frames.",
    "transfer": "depth: indentation, z + a + p (1 - cos tilt); over answered frames. The tested "
    "sensor gives its rest image and so many labelled frames, nothing else.",
}

HEADLINES = {
    "exp1": ("mae_mm", "mean", "missed", 4),
    "exp2": ("distance_penalised_mm", "all", "resolved", 3),
    "exp3": ("position_mean_mm", "all", "missed", 3),
    "stability": ("ospa_mm", "all", "missed", 3),
    "surface": ("depth_mae_mm", "all", "coverage", 4),
    "transfer": ("depth_mae_mm", "0", "coverage", 3),
}
"""The error to show beside speed: metric, group, the share that qualifies it, decimals."""

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
"""Column heads of the main tables."""

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
    "surface_rmse_mm": "surface RMSE of the heatmap",
    "threshold_mm": "two-point threshold (75 %)",
    "tilt_mae_deg": "tilt error",
    "tilt_mae_minus_published_deg": "tilt error minus released",
    "tilt_mae_minus_published_p": "p of that",
    "worst_ratio": "largest error / error of the easy case",
}
"""Names in sentences and lists."""

SHARES = frozenset({"catch_resolved", "coverage", "missed", "resolved"})
"""Metrics in 0..1 that are shown in per cent."""
