"""Metrics of test frames, computed by name, as rows of the record."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from tactibench.errors import UserError
from tactibench.metrics.registry import all_metrics, find_metric
from tactibench.metrics.spec import MetricSpec, Rows
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.records import Metric
from tactibench.stats import Estimate


def score(
    names: Sequence[str], trials: Trials | PlateTrials, *, rng: np.random.Generator
) -> list[Metric]:
    """Compute metrics in the order of their names, each with its groups in the table's order.

    Every metric gets its own random numbers from one draw of ``rng`` and its name, so an interval
    does not depend on which other metrics were requested.

    Args:
        names: Names of the metrics.
        trials: Test frames.
        rng: Random numbers of the bootstraps and permutations.

    Raises:
        UserError: A metric is unknown or does not apply to answers of this kind.
    """
    specs = [find_metric(name) for name in names]
    seed = int(rng.integers(2**63))
    rows = []
    for spec in specs:
        random = np.random.default_rng([seed, zlib.crc32(spec.name.encode())])
        rows += [_metric(spec, group, estimate) for group, estimate in _rows(spec, trials, random)]
    return rows


def _metric(spec: MetricSpec, group: str, estimate: Estimate) -> Metric:
    """Return a row of the record; it has ``censored`` and ``method`` only where they apply."""
    values = {
        "metric": spec.name,
        "group": group,
        **asdict(estimate),
        "unit": spec.unit,
        "better": spec.better,
    }
    for name in ("censored", "method"):
        if values[name] is None:
            del values[name]
    return Metric.model_validate(values)


def _rows(spec: MetricSpec, trials: Trials | PlateTrials, rng: np.random.Generator) -> Rows:
    if isinstance(trials, PlateTrials):
        if spec.plates is not None:
            return spec.plates(trials, rng)
        fitting = [name for name, other in all_metrics().items() if other.plates]
        kind = "plate poses"
    else:
        if spec.contacts is not None:
            return spec.contacts(trials, rng)
        fitting = [name for name, other in all_metrics().items() if other.contacts]
        kind = "contacts"
    raise UserError(
        f"metric {spec.name!r} does not apply to answers that are {kind}: "
        f"the protocol may ask for {', '.join(sorted(fitting))}."
    )
