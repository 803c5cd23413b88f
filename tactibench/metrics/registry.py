"""Every metric by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from tactibench.errors import UserError, did_you_mean
from tactibench.metrics import (
    detection,
    gospa,
    hard_cases,
    location,
    plate,
    position,
    separation,
    surface,
    threshold,
    uncertainty,
)
from tactibench.metrics.spec import MetricSpec
from tactibench.protocols.loader import LoadedProtocol

METRICS: Mapping[str, MetricSpec] = MappingProxyType(
    {
        spec.name: spec
        for family in (
            location,
            position,
            separation,
            threshold,
            detection,
            gospa,
            surface,
            plate,
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


def check_metrics(protocol: LoadedProtocol) -> None:
    """Refuse metrics that do not exist or do not fit the answers, before any work is done.

    Apart from ``read_protocol``, which imports nothing that the metrics compute with.
    Raises UserError with the close match.
    """
    keys = protocol.keys
    kind = "plates" if keys.answer == "plate" else "contacts"
    fitting = [name for name, spec in METRICS.items() if getattr(spec, kind) is not None]
    for name in keys.metrics.names:
        if name not in fitting:
            raise UserError(
                f"protocol file {protocol.path}: key 'metrics.names' holds {name!r}, which is no "
                f"metric of answers that are {kind}; {did_you_mean(name, fitting)}"
            )
