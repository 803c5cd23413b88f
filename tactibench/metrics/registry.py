"""Metrics by name: their rows, and their values press by press.

The modules of the metrics are imported when the first metric is asked for.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import FloatArray
from tactibench.errors import UserError, did_you_mean
from tactibench.metrics.spec import FIELDS, Mask, MetricSpec, Sample, members
from tactibench.metrics.trials import AnyTrials, PlateTrials, SiteTrials, Trials
from tactibench.protocols import LoadedProtocol, board_spec
from tactibench.records import Metric
from tactibench.stats import Estimate

FAMILIES = (
    *("position", "threshold", "detection", "surface", "uncertainty", "hard_cases"),
    "sites",
)
"""Modules of ``tactibench.metrics`` with metrics, in the order of a list of all of them."""


@cache
def all_metrics() -> Mapping[str, MetricSpec]:
    """Return every metric by its name."""
    return MappingProxyType({spec.name: spec for spec in _specs()})


def _specs() -> Iterator[MetricSpec]:
    """Yield all metrics; the module of a family is imported when its first metric is reached."""
    for family in FAMILIES:
        yield from import_module(f"tactibench.metrics.{family}").SPECS


@cache
def find_metric(name: str) -> MetricSpec:
    """Return the metric of a name.

    Raises:
        UserError: There is no such metric. The message names a close match.
    """
    spec = next((spec for spec in _specs() if spec.name == name), None)
    if spec is None:
        raise UserError(f"there is no metric {name!r}; {did_you_mean(name, all_metrics())}")
    return spec


def check_metrics(protocol: LoadedProtocol) -> None:
    """Refuse metrics that do not exist or do not fit the answers, before any work is done.

    This is no part of ``read_protocol``, which imports nothing that the metrics compute with.

    Raises:
        UserError: A metric of the protocol or of its board file does not exist, or is no metric of
            its kind of answers. The message names a close match.
    """
    spec = protocol.spec
    kind = FIELDS[spec.answer][0]
    keys = [("metrics.names", spec.metrics.names)]
    keys += [(f"metrics of test.apart {test.name!r}", test.metrics) for test in spec.test.apart]
    for key, name in ((key, name) for key, names in keys for name in names):
        with suppress(UserError):
            if getattr(find_metric(name), kind) is not None:
                continue
        fitting = [other for other, metric in all_metrics().items() if getattr(metric, kind)]
        raise UserError(
            f"protocol file {protocol.path}: key {key!r} holds {name!r}, which is no "
            f"metric of answers that are {kind}; {did_you_mean(name, fitting)}"
        )
    for name in sorted(board_spec(spec.label).metrics):
        if name not in all_metrics():
            raise UserError(
                f"the board file of {spec.id!r} shows {name!r}, which is no metric; "
                f"{did_you_mean(name, all_metrics())}"
            )


def score(names: Sequence[str], trials: AnyTrials, *, rng: np.random.Generator) -> list[Metric]:
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
        of_groups = _function(spec.name, trials)(trials, random)
        rows += [_metric(spec, group, estimate) for group, estimate in of_groups]
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


def _kind(trials: AnyTrials) -> str:
    by_type = {Trials: "contacts", PlateTrials: "plate", SiteTrials: "sites"}
    return by_type[type(trials)]


def _function(name: str, trials: AnyTrials, *, sample: bool = False) -> Callable[..., Any]:
    """Return the function of a metric that makes its rows, or its values, of trials.

    Raises:
        UserError: The metric is unknown, or has no such function.
    """
    kind = _kind(trials)
    field = FIELDS[kind][sample]
    function: Callable[..., Any] | None = getattr(find_metric(name), field)
    if function is None:
        able = ", ".join(sorted(n for n, spec in all_metrics().items() if getattr(spec, field)))
        means = " press by press" if sample else ""
        words = {"plate": "plate poses"}.get(kind, kind)
        raise UserError(
            f"metric {name!r} cannot be computed{means} from answers that are {words}; "
            f"choose one of {able}."
        )
    return function


def press_means(name: str, trials: AnyTrials, groups: Sequence[str] = ("all",)) -> FloatArray:
    """Return the means of a metric's values, (P, groups), NaN where a press has none in a group.

    Args:
        name: Name of the metric.
        trials: Test frames, of which ``np.unique(trials.press)`` are the P presses.
        groups: Names of groups of trials.

    Raises:
        UserError: The metric is no mean over presses of trials of this kind.
    """
    columns = []
    for group in groups:
        sums, counts = _press_sums(name, trials, group)
        columns.append(np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0))
    return np.stack(columns, axis=1)


def press_shares(name: str, trials: AnyTrials, group: str = "all") -> FloatArray:
    """Return what each press has of a metric: (P,) values with the metric as their mean.

    It is the sum of a press's values over the mean number of values of a press, and so the mean of
    the press where all have the same number. NaN where a press has no value.

    Args:
        name: Name of the metric.
        trials: Test frames, of which ``np.unique(trials.press)`` are the P presses.
        group: Name of a group of trials.

    Raises:
        UserError: The metric is no mean over presses of trials of this kind.
    """
    sums, counts = _press_sums(name, trials, group)
    number = counts.sum() / max(np.count_nonzero(counts), 1)
    shares = np.full(len(sums), np.nan)
    np.divide(sums, number, out=shares, where=counts > 0)
    return shares


def _press_sums(
    name: str, trials: AnyTrials, group: str
) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the sum of a metric's values, and their number, of every press."""
    sample: Sample = _function(name, trials, sample=True)(trials)
    unique, codes = np.unique(trials.press, return_inverse=True)
    inside = _members(trials, group)[sample.trial]
    press = codes[sample.trial[inside]]
    sums: FloatArray = np.bincount(press, sample.values[inside], len(unique)).astype(np.float64)
    return sums, np.bincount(press, minlength=len(unique))


def compared_metrics(trials: AnyTrials, names: Iterable[str]) -> list[str]:
    """Return the metrics that are means over presses and can be compared press by press."""
    field, specs = FIELDS[_kind(trials)][1], map(find_metric, names)
    return [spec.name for spec in specs if getattr(spec, field) and not spec.root]


def _members(trials: AnyTrials, group: str) -> Mask:
    if isinstance(trials, Trials):
        return members(trials, group)
    if isinstance(trials, SiteTrials):
        from tactibench.metrics.sites import groups

        return dict(groups(trials))[group]
    everything = np.ones(len(trials), dtype=bool)
    return everything if group == "all" else np.array(trials.group, dtype=object) == group
