"""Every metric by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from tactibench.errors import UserError, did_you_mean
from tactibench.metrics import (
    depth,
    detection,
    gospa,
    hard_cases,
    location,
    plate,
    position,
    released,
    separation,
    surface,
    threshold,
    uncertainty,
)
from tactibench.metrics.spec import MetricSpec

METRICS: Mapping[str, MetricSpec] = MappingProxyType(
    {
        spec.name: spec
        for family in (
            location,
            position,
            depth,
            separation,
            threshold,
            detection,
            gospa,
            surface,
            plate,
            released,
            uncertainty,
            hard_cases,
        )
        for spec in family.SPECS
    }
)


def find_metric(name: str) -> MetricSpec:
    """Return the metric of that name. Raises UserError with the close match."""
    if name not in METRICS:
        raise UserError(f"there is no metric {name!r}; {did_you_mean(name, METRICS)}")
    return METRICS[name]
