"""Every metric by name; the module of a metric is imported when the metric is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from tactibench.errors import UserError, did_you_mean
from tactibench.metrics.spec import MetricSpec
from tactibench.protocols import LoadedProtocol

_FAMILIES = {
    "location": ("r2", "mae_mm", "rmse_mm", "rmse_pooled_mm", "rmse_over_bound"),
    "position": (
        "position_mean_mm",
        "position_ungated_mm",
        "depth_mae_mm",
        "relative_depth_mae_mm",
    ),
    "separation": (
        "distance_mae_mm",
        "distance_penalised_mm",
        "resolved",
        "orientation_mae_deg",
    ),
    "threshold": (
        "threshold_mm",
        "threshold_lapse",
        "threshold_deviance",
        "threshold_freedom",
        "threshold_p",
        "limit_mm",
    ),
    "detection": ("missed", "spurious", "catch_resolved", "d_prime"),
    "gospa": ("gospa1_mm", "gospa2_mm"),
    "surface": ("surface_rmse_mm", "surface_floor_mm", "surface_excess_mm"),
    "plate": (
        "tilt_mae_deg",
        "coverage",
        "depth_mae_minus_published_mm",
        "depth_mae_minus_published_p",
        "tilt_mae_minus_published_deg",
        "tilt_mae_minus_published_p",
    ),
    "uncertainty": (
        "nll",
        "rms_z",
        "ellipse_50",
        "ellipse_90",
        "ellipse_95",
        "std_over_bound",
    ),
    "hard_cases": (
        "ospa_mm",
        "error_ratio",
        "worst_ratio",
        "doubles_at",
        "false_per_1000",
        "not_finite",
        "raised",
    ),
}
"""Module -> names of its SPECS: a protocol asks for a few metrics and loads only their code."""
FAMILIES: Mapping[str, str] = MappingProxyType(
    {name: family for family, names in _FAMILIES.items() for name in names}
)
"""Name of every metric -> its module in ``tactibench.metrics``."""


def find_metric(name: str) -> MetricSpec:
    """Return the metric of a name.

    Raises:
        UserError: There is no such metric. The message names a close match.
    """
    if name not in FAMILIES:
        raise UserError(f"there is no metric {name!r}; {did_you_mean(name, FAMILIES)}")
    specs = import_module(f"tactibench.metrics.{FAMILIES[name]}").SPECS
    spec: MetricSpec = next(spec for spec in specs if spec.name == name)
    return spec


def all_metrics() -> dict[str, MetricSpec]:
    """Import the code of all metrics and return every metric by its name."""
    return {name: find_metric(name) for name in FAMILIES}


def check_metrics(protocol: LoadedProtocol) -> None:
    """Refuse metrics that do not exist or do not fit the answers, before any work is done.

    This is no part of ``read_protocol``, which imports nothing that the metrics compute with.

    Raises:
        UserError: A metric of the protocol does not exist, or is no metric of its kind of answers.
            The message names a close match.
    """
    spec = protocol.spec
    kind = "plates" if spec.answer == "plate" else "contacts"
    keys = [("metrics.names", spec.metrics.names)]
    keys += [(f"metrics of test.apart {test.name!r}", test.metrics) for test in spec.test.apart]
    for key, name in ((key, name) for key, names in keys for name in names):
        if name in FAMILIES and getattr(find_metric(name), kind) is not None:
            continue
        fitting = [other for other, metric in all_metrics().items() if getattr(metric, kind)]
        raise UserError(
            f"protocol file {protocol.path}: key {key!r} holds {name!r}, which is no "
            f"metric of answers that are {kind}; {did_you_mean(name, fitting)}"
        )
