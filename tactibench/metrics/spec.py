"""A metric as a record: its name, unit, direction, formula, and the functions behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.metrics.trials import PlateTrials, Trials
from tactibench.stats import Estimate, IntArray

Rows = Iterable[tuple[str, Estimate]]
"""(group, estimate) pairs in the order of the table."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The values that a metric averages.

    Attributes:
        values: (n,).
        trial: (n,) index of the frame that each value belongs to.

    Raises:
        ValueError: ``values`` and ``trial`` differ in shape.
    """

    values: FloatArray
    trial: IntArray

    def __post_init__(self) -> None:
        if self.values.shape != self.trial.shape:
            raise ValueError(f"{self.values.shape} values of {self.trial.shape} trials")


@dataclass(frozen=True)
class MetricSpec:
    """One metric.

    Attributes:
        name: Name of the metric.
        unit: Unit of its values.
        better: "lower", "higher" or "none".
        formula: The formula in words and symbols, for the documentation.
        contacts: Its rows from trials with contacts; None where it does not apply.
        plates: Its rows from trials with plate poses; None where it does not apply.
        sample: Values of trials with contacts whose mean (or root mean square) it is, for paired
            comparison; None where it is no mean and cannot be compared press by press.
        plate_sample: The same of trials with plate poses.
        root: Whether it is the root of that mean.
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
