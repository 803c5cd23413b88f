"""A metric as a record, and its rows: one summary of every group of trials.

A group named by a number is a *condition* (a true distance, mm): only metrics of separation are
shown for each condition. The other groups (dual, triple) are *kinds*: metrics of contacts are shown
for each kind. Both lists end with "all". Catch trials are neither a condition nor a kind, and are
not in "all". Frames in which nothing presses under a fault ("untouched:dim") are kinds, but not in
"all": they test for false contacts alone, which would count little in a mean with all others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray
from tactibench.metrics.trials import CATCH, PlateTrials, SiteTrials, Trials
from tactibench.protocols import UNTOUCHED, family_of
from tactibench.stats import Estimate, IntArray, Labels, positive_mean_interval

Rows = Iterable[tuple[str, Estimate]]
"""(group, estimate) pairs in the order of the table."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The values that a metric averages; those that are not known (NaN) are left out.

    Attributes:
        values: (n,).
        trial: (n,) index of the frame that each value belongs to.
    """

    values: FloatArray
    trial: IntArray

    def __post_init__(self) -> None:
        known = ~np.isnan(self.values)
        if not known.all():
            object.__setattr__(self, "values", self.values[known])
            object.__setattr__(self, "trial", self.trial[known])


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
        sites: Its rows from trials with named places; None where it does not apply.
        site_sample: Values of such trials whose mean it is.
        root: Whether it is the root of that mean.
        needs_depth: Whether it has no value where depths are not known.
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
    sites: Callable[[SiteTrials, np.random.Generator], Rows] | None = None
    site_sample: Callable[[SiteTrials], Sample] | None = None
    needs_depth: bool = False


FIELDS = {
    "contacts": ("contacts", "sample"),
    "plate": ("plates", "plate_sample"),
    "sites": ("sites", "site_sample"),
}
"""Kind of answer -> fields of a ``MetricSpec`` with the rows and with the values of trials."""


Mask = npt.NDArray[np.bool_]
Groups = Mapping[str, Mask]
Summary = Callable[..., Estimate]
"""``summary(values, clusters, level=...)``, one of `tactibench.stats.intervals`."""


def condition(name: str) -> float | None:
    """Return the number that is the name of a group; None where the name is no finite number."""
    try:
        number = float(name)
    except ValueError:
        return None
    return number if np.isfinite(number) else None


def members(trials: Trials, name: str) -> Mask:
    """Return (N,) whether each trial belongs to a group.

    The group "all" has all trials but catch trials and frames in which nothing presses under a
    fault.
    """
    if name == "all":
        inside = [g != CATCH and family_of(g) != UNTOUCHED for g in trials.group]
    else:
        inside = [g == name for g in trials.group]
    return np.array(inside, dtype=bool)


def by_condition(trials: Trials) -> Groups:
    """Return the members of each distance in ascending order, then those of "all"."""
    names = {name: number for name in set(trials.group) if (number := condition(name)) is not None}
    return {name: members(trials, name) for name in (*sorted(names, key=names.__getitem__), "all")}


def by_kind(trials: Trials) -> Groups:
    """Return the members of each kind in alphabetical order, then those of "all"."""
    kinds = {g for g in trials.group if g not in {CATCH, "all"} and condition(g) is None}
    return {name: members(trials, name) for name in (*sorted(kinds), "all")}


def rows(sample: Sample, groups: Groups, summary: Summary, press: Labels, level: float) -> Rows:
    """Yield one estimate per group, from the values of its trials.

    Args:
        sample: Values and the trial of each.
        groups: Members of every group.
        summary: Function that makes an estimate of values and their clusters.
        press: (N,) press ids of the trials, the clusters.
        level: Level of the intervals.
    """
    for name, member in groups.items():
        inside = member[sample.trial]
        clusters = press[sample.trial[inside]]
        yield name, summary(sample.values[inside], clusters, level=level)


def mean_metric(
    name: str,
    unit: str,
    better: str,
    formula: str,
    sample: Callable[[Trials], Sample],
    summary: Summary = positive_mean_interval,
    groups: Callable[[Trials], Groups] = by_kind,
    **others: Any,
) -> MetricSpec:
    """Return the spec of a metric that is one summary of one sample, group by group.

    Args:
        name: Name of the metric.
        unit: Unit of its values.
        better: "lower", "higher" or "none".
        formula: The formula in words and symbols, for the documentation.
        sample: Function that returns the values of trials.
        summary: Function that makes an estimate of values and their clusters.
        groups: Function that returns the groups of trials, such as ``by_kind``.
        **others: Other fields of ``MetricSpec``.
    """
    return MetricSpec(
        name,
        unit,
        better,
        formula,
        contacts=lambda trials, _rng: rows(
            sample(trials), groups(trials), summary, trials.press, trials.level
        ),
        sample=sample,
        **others,
    )


def plate_rows(
    sample: Callable[[PlateTrials], Sample], summary: Summary
) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    """Return the function that yields the rows of a metric of plate poses.

    There is one row for every group, in the order of the frames.
    """

    def make(trials: PlateTrials, _rng: np.random.Generator) -> Rows:
        of = np.array(trials.group or ("all",) * len(trials), dtype=object)
        groups = {name: of == name for name in dict.fromkeys(of)} or {"all": of == "all"}
        return rows(sample(trials), groups, summary, trials.press, trials.level)

    return make
