"""Rows of a board: one model in one configuration, its training seeds pooled, and its costs.

Value: mean over seeds. Interval: mean of the seeds' intervals, end by end. The seeds answer the
same presses, and the standard deviation of a mean is at most the mean of the standard deviations
(Minkowski), so this interval covers the sampling of presses at least as often as it says. It does
not contain the seeds' own spread, which is ``sd``: their sample standard deviation.
"""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np

from tactibench.errors import UserError
from tactibench.metrics import AXES
from tactibench.plugins import Catalogue, ModelSpec, PluginHost, installed
from tactibench.protocols import load_protocol
from tactibench.records import Record, canonical, digest
from tactibench.run import SHIPPED, SHOTS, holds_several, settled_time

BOUND = "rmse_over_bound"
BELOW_BOUND = (
    "more exact than the Cramer-Rao bound of the frames, which no unbiased reading of them is: the "
    "model may know more than the frames say, such as the test presses"
)
TRIVIAL = frozenset({"mean", "nearest"})
"""Models that learn next to nothing: any other model has to beat them."""


def below_bound(value: float | None, high: float | None) -> bool:
    """Return whether an error over its Cramer-Rao bound is below 1, with its whole interval."""
    return value is not None and (value if high is None else high) < 1.0


NOT_STATED = "not stated"


@cache
def shipped_models() -> Catalogue[ModelSpec]:
    """Return the models that ship; a plugin of anybody else is not imported."""
    return PluginHost([pair for pair in installed() if pair[1].distribution == SHIPPED]).models


def prior_of(record: Record) -> str:
    """Return what the model of a record knew of contacts that press together, see ``Prior``.

    Of a model that ships it follows from its spec and its parameters. Of any other one it is the
    word of the record.
    """
    model = record.model
    try:
        spec = load_protocol(record.protocol.id).spec
        own = shipped_models().for_answer(spec.answer)[model.name]
    except UserError:  # of somebody else, or of a protocol that is not here
        return record.training.prior or NOT_STATED
    several = record.regime in spec.regimes and holds_several(spec, record.regime)
    return own.prior(model.parameters, spec.answer, several=several)


def draws_nothing(record: Record) -> bool:
    """Return whether a training draws nothing at random, as the spec of its model says.

    A training for another sensor may draw how sensors differ (``kernel`` does).
    """
    own = shipped_models().specs.get(record.model.name)
    return own is not None and own.deterministic and not trained_on(record)


def model_text(record: Record) -> str:
    """Return the model with its settings, and how many presses of the test it was shown."""
    text = record.model.text()
    return f"{text}, {record.shots:,} labelled presses" if record.shots else text


def label_of(record: Record, *, shots: bool = True, regime: bool = True) -> str:
    """Return the name of a row: its model, and all that differs from the default.

    So ``unet`` has the encoder of the protocol and its first regime, and the row called
    ``unet, faults=0.5 (multiple)`` differs in a setting and in the regime.

    Args:
        record: Record of the run.
        shots: Whether the line says how many labelled presses of the tested sensor the model was
            shown.
        regime: Whether the line says in which regime the model was trained.
    """
    text = model_text(record) if shots else record.model.text()
    usual_encoder, usual_regime = _usual(record.protocol.id)
    encoder = record.encoder
    own = (usual_encoder, record.model.name)  # a model may bring an encoder of its name
    if encoder is not None and (encoder.changed or encoder.name not in own):
        text += f" + {encoder.text()}"
    return f"{text} ({record.regime})" if regime and record.regime != usual_regime else text


def _usual(protocol: str) -> tuple[str | None, str | None]:
    """Return the default encoder and the first regime of a protocol; None where it is unknown."""
    try:
        spec = load_protocol(protocol).spec
    except UserError:  # not installed here, or broken since: the name then says all
        return None, None
    return spec.defaults.encoder, next(iter(spec.regimes))


def trained_on(record: Record) -> str:
    """Return the training sensor of a model that was tested on another one; "" for the same."""
    test = record.test_sensor
    return "" if test is None else test.trained_on or ""


def fitted_words(record: Record) -> str:
    """Return what was fitted to labelled frames of the tested sensor, besides a model; "" for none.

    These are the simulated sensor of the training, and offset and pivot of the labels.
    """
    seen = record.data.of_tested_sensor
    if seen is None or not trained_on(record):
        return ""
    fit = seen.described.get("label_fit")
    labels = int(fit["presses"]) if isinstance(fit, Mapping) else 0
    text = f"Offset and pivot of the labels were fitted to {labels:,} labelled frames"
    if seen.left_out_calibrated:
        text += f", the simulated sensor to {seen.left_out_calibrated:,} others, which test nothing"
    return f"{text}."


def command_options(record: Record) -> str:
    """Return the options that select the test of a run, such as " --test reference", or "".

    Labelled presses are left out: they are no part of the test, and a row says how many were shown.
    """
    test = record.test_sensor
    options = [] if test is None else [o for o in test.options if not o.startswith(f"{SHOTS}=")]
    return "".join(" --hidden-seed" if text == "hidden" else f" --test {text}" for text in options)


@dataclass(frozen=True)
class PooledMetric:
    """A number over seeds.

    Attributes:
        value: Mean over seeds.
        low: Lower end of the interval.
        high: Upper end of the interval.
        sd: Sample standard deviation over seeds; None for one seed.
        clusters: Number of presses behind the number in one seed, the fewest and the most.
        unit: Unit of the value.
        censored: "<" or ">" where the value is only a limit, of every seed.
        seeds: Number of seeds.
        limits: Words for seeds that have only a limit and are not in the value, such as "2 of 3
            seeds > 6.5"; "" for none.
    """

    value: float
    low: float | None
    high: float | None
    sd: float | None
    clusters: tuple[int, int]
    unit: str
    censored: str | None = None
    seeds: int = 1
    limits: str = ""


@dataclass(frozen=True)
class Row:
    """The seeds of one configuration, sorted by seed.

    Attributes:
        records: One record a seed.
        mark: Text that tells rows apart whose parameters differ although their labels do not.
    """

    records: tuple[Record, ...]
    mark: str = ""

    @property
    def first(self) -> Record:
        """The record of the first seed, for all that the seeds share."""
        return self.records[0]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Training seeds."""
        return tuple(record.seed for record in self.records)

    @property
    def label(self) -> str:
        """Name of the row."""
        return label_of(self.first) + self.mark

    @property
    def short(self) -> str:
        """The label without the regime."""
        return label_of(self.first, regime=False) + self.mark

    @property
    def model(self) -> str:
        """The model with its parameters and what it was shown of the tested sensor."""
        return model_text(self.first) + self.mark

    @property
    def encoder(self) -> str:
        """The encoder with its settings, "" for none."""
        encoder = self.first.encoder
        return "" if encoder is None else encoder.text()

    @property
    def regime(self) -> str:
        """Training regime."""
        return self.first.regime

    @property
    def default(self) -> bool:
        """True for a model whose settings, encoder and training are at their defaults."""
        return label_of(self.first, regime=False) == self.first.model.name

    @property
    def prior(self) -> str:
        """What it knew of contacts that press together, see ``prior_of``."""
        return prior_of(self.first)

    @property
    def trivial(self) -> bool:
        """True for a model that learns next to nothing."""
        return self.first.model.name in TRIVIAL

    @property
    def reproduced(self) -> str:
        """By whom its runs were made again, such as "reproduced by a lab"; else "as submitted"."""
        notes = [note for record in self.records if (note := record.reproduced) is not None]
        if not notes:
            return "as submitted"
        share = "" if len(notes) == len(self.records) else f"{len(notes)} of {len(self.records)} "
        return f"{share}reproduced by {' and '.join(sorted({note.by for note in notes}))}"

    @property
    def below_bound(self) -> bool:
        """True where an error is surely below the Cramer-Rao bound, see ``below_bound``."""
        pooled = (self.metric(BOUND, axis) for axis in AXES)
        return any(
            below_bound(axis_error.value, axis_error.high)
            for axis_error in pooled
            if axis_error is not None
        )

    def metric(self, metric: str, group: str) -> PooledMetric | None:
        """Return a metric over all seeds.

        None where a seed has no value, because the other seeds alone could look too good. Where
        some seeds have a value and some a limit, the value is that of the former.
        """
        rows = [row for record in self.records if (row := record.metric(metric, group))]
        if not rows or any(row.value is None for row in rows) or len(rows) < len(self.records):
            return None
        marks = {row.censored for row in rows if row.censored}
        limited = [f"{row.censored} {row.value:g}" for row in rows if row.censored]
        if measured := [row for row in rows if not row.censored]:
            rows, marks = measured, set()
        if len(marks) > 1:
            return None
        values = [row.value for row in rows if row.value is not None]
        counts = [row.clusters for row in rows]
        of_all = f"{len(limited)} of {len(self.records)} seeds"
        limits = f"{of_all} {', '.join(sorted(set(limited)))}" if measured and limited else ""
        return PooledMetric(
            statistics.fmean(values),
            _mean_or_none([row.low for row in rows]),
            _mean_or_none([row.high for row in rows]),
            _deviation(values) if len(values) > 1 and not marks else None,
            (min(counts), max(counts)),
            rows[0].unit,
            next(iter(marks), None),
            len(values),
            limits,
        )

    def over(self, quantity: Callable[[Record], float | None]) -> list[float]:
        """Return a quantity of every seed that has it."""
        return [value for record in self.records if (value := quantity(record)) is not None]


def _deviation(values: Sequence[float]) -> float:
    """Return the sample standard deviation, which is 0 for equal values."""
    return float(np.std(np.array(values) - values[0], ddof=1))


def _mean_or_none(ends: Sequence[float | None]) -> float | None:
    given = [end for end in ends if end is not None]
    return statistics.fmean(given) if given and len(given) == len(ends) else None


def row_key(record: Record) -> list[Any]:
    """Return everything that two records must share to be seeds of one row, as JSON values."""
    encoder = None if record.encoder is None else record.encoder.identity
    model = record.model.identity
    key = [section_key(record), model, encoder, record.regime, record.limits.presses]
    return [*key, record.shots] if record.shots else key


def row_anchor(row: Row) -> str:
    """Return a name for links to a row: it stays the same when rows and seeds are added."""
    words = re.sub(r"[^a-z0-9]+", "-", row.label.lower()).strip("-")
    return f"{words[:40].rstrip('-')}-{digest(row_key(row.first))[:8]}"


def section_key(record: Record, *, frames: bool = True) -> list[Any]:
    """Return everything that two records must share to stand in one table, as JSON values.

    These are the question, the sensor and the test frames.

    Args:
        record: Record of a run.
        frames: Whether the key holds the hash of the test frames, which nobody can derive without
            these frames.
    """
    test = record.test_sensor
    key = [
        record.protocol.id,
        record.protocol.hash,
        *training_sensor(record),
        record.identity.data if frames else None,
    ]
    if test is None:
        return key
    key += [test.name, test.parameters]
    return [*key, test.trained_on] if test.trained_on else key


def training_sensor(record: Record) -> list[Any]:
    """Return everything that two records must share to be trained on one sensor, as JSON values."""
    sensor = record.sensor
    return [sensor.origin, sensor.name, sensor.parameters]


def trained_for(records: Iterable[Record]) -> list[Record]:
    """Return the records that were tested on the sensor that they were trained for."""
    return [record for record in records if record.test_sensor is None]


def whole(records: Iterable[Record]) -> list[Record]:
    """Return the records that learned from all presses; the others belong to learning curves."""
    return [record for record in records if record.limits.presses is None]


def rows_of(records: Iterable[Record]) -> list[Row]:
    """Return records with their seeds pooled, in the order of their labels."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(canonical(row_key(record)), []).append(record)
    seeds = [tuple(sorted(group, key=lambda r: r.seed)) for group in groups.values()]
    labels = Counter(_shown(records[0]) for records in seeds)
    rows = [Row(records, _mark(records[0], labels)) for records in seeds]
    return sorted(rows, key=lambda row: (row.first.shots, row.label, row.first.limits.presses or 0))


def _mark(record: Record, labels: Mapping[tuple[str, int | None], int]) -> str:
    return f" #{digest(row_key(record))[:4]}" if labels[_shown(record)] > 1 else ""


def _shown(record: Record) -> tuple[str, int | None]:
    return label_of(record), record.limits.presses


def by_machine(row: Row) -> list[Row]:
    """Return the row divided by machine: one row for every machine that its seeds were timed on."""
    groups: dict[str, list[Record]] = {}
    for record in row.records:
        groups.setdefault(machine(record), []).append(record)
    return [Row(tuple(groups[name]), row.mark) for name in sorted(groups)]


def frames_per_second(record: Record) -> float | None:
    """Return the frames per second of the fastest batch size and thread count."""
    rates = [row.per_s for row in record.speed if row.phase == "total"]
    return max(rates, default=None)


def latency(
    record: Record,
    *,
    threads: int | None,
    statistic: Literal["p50_ms", "p90_ms"] = "p90_ms",
) -> float | None:
    """Return the milliseconds from one frame to its contacts; None where a run was not timed so.

    Args:
        record: Record of the run.
        threads: Number of threads; None: the largest number that was timed.
        statistic: Quantile of the times.
    """
    totals = [
        row
        for row in record.speed
        if (row.scenario, row.batch, row.phase) == ("single", 1, "total")
    ]
    if threads is None:
        threads = max((row.threads for row in totals), default=0)
    return next((getattr(row, statistic) for row in totals if row.threads == threads), None)


def machine(record: Record) -> str:
    """Return the fingerprint of the hardware that a record was timed on."""
    return record.environment.fingerprint


def settled(row: Row) -> bool:
    """Return whether the times of a row for single frames on one thread are settled."""
    return all(
        settled_time(speed)
        for record in row.records
        for speed in record.speed
        if (speed.scenario, speed.threads) == ("single", 1)
    )
