"""A metric as a record: its name, unit, direction, formula, and the functions behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.stats.clusters import IntArray
from tactibench.stats.intervals import Estimate

Rows = Iterable[tuple[str, Estimate]]
"""(group, estimate) pairs in the order of the table."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The values a metric averages. values: (n,). trial: (n,) the frame each belongs to."""

    values: FloatArray
    trial: IntArray

    def __post_init__(self) -> None:
        if self.values.shape != self.trial.shape:
            raise ValueError(f"{self.values.shape} values of {self.trial.shape} trials")


@dataclass(frozen=True)
class MetricSpec:
    """One metric.

    better: "lower", "higher" or "none". formula: in words and symbols, for the documentation.
    contacts, plates: its rows from trials of either kind; None: it does not apply.
    sample, plate_sample: values whose mean (or root mean square) it is, for paired comparison;
    None: it is no mean and cannot be compared press by press. root: it is the root of that mean.
    """

    name: str
    unit: str
    better: str
    formula: str
    contacts: Callable[[Trials, np.random.Generator], Rows] | None = None
    plates: Callable[[PlateTrials, np.random.Generator], Rows] | None = None
    sample: Callable[[Trials], Sample] | None = None
    plate_sample: Callable[[PlateTrials], Sample] | None = None
    root: bool = False
