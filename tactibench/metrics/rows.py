"""One line of a record's metrics."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from tactibench.metrics.spec import MetricSpec
from tactibench.stats.estimate import Estimate


@dataclass(frozen=True)
class MetricRow:
    """A metric of one group. None stands for n/a; `Estimate` has refused NaN.

    n: values averaged. clusters: presses. censored: "<" or ">" when the value is only a limit.
    """

    metric: str
    group: str
    value: float | None
    low: float | None
    high: float | None
    n: int
    clusters: int
    unit: str
    better: str
    censored: str | None = None

    @classmethod
    def of(cls, spec: MetricSpec, group: str, estimate: Estimate) -> MetricRow:
        """Name the estimate by its metric and group."""
        e = estimate
        return cls(
            spec.name,
            group,
            e.value,
            e.low,
            e.high,
            e.n,
            e.clusters,
            spec.unit,
            spec.better,
            e.censored,
        )

    def as_json(self) -> dict[str, Any]:
        """Plain dictionary for the record; ``censored`` appears only where it applies."""
        return {k: v for k, v in asdict(self).items() if k != "censored" or v is not None}
