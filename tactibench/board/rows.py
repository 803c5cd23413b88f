"""Rows of a board: one model in one configuration, its training seeds pooled, and its name.

Value: mean over seeds. Interval: mean of the seeds' intervals, end by end. The seeds answer the
same presses, and the standard deviation of a mean is at most the mean of the standard deviations
(Minkowski), so this interval covers the sampling of presses at least as often as it says. It does
not contain the seeds' own spread, which is ``sd``: their sample standard deviation.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tactibench.board.shipped import one_contact_models
from tactibench.metrics import AXES
from tactibench.records import Record
from tactibench.run import SHOTS

MIXING = "mixing"
"""Parameter of models that can train on frames mixed out of single presses: how many they mix."""
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


def mixing_of(record: Record) -> float:
    """Return the number of frames mixed out of single presses for every training frame."""
    share = record.training.notes.get(MIXING, record.model.parameters.get(MIXING))
    return max(float(share), 0.0) if isinstance(share, int | float) else 0.0


NOT_STATED = "not stated"


def prior_of(record: Record) -> str:
    """Return what a model knew of contacts that press together, see ``FitReport.prior``.

    For a record that is older than this field it follows from the model's parameters and notes.
    """
    stated = record.training.prior or record.training.notes.get("prior")
    if stated:
        return str(stated)
    parameters, name = record.model.parameters, record.model.name
    if mixing_of(record):
        return NOT_STATED
    # A network that mixed no frames has nothing but the frames that it was given.
    no_prior = MIXING in parameters or name in TRIVIAL or name in one_contact_models()
    return "none" if no_prior else NOT_STATED


def model_text(record: Record) -> str:
    """Return the model with its parameters, and how many presses of the tested sensor it was shown.

    Mixing is left out, because it has its own column.
    """
    text = record.model.text(without=MIXING)
    if record.shots:
        text += f", {record.shots:,} labelled presses"
    return text


def label_of(record: Record, *, shots: bool = True, regime: bool = True) -> str:
    """Return model, encoder where there is one, mixing and regime, in one line.

    Args:
        record: Record of the run.
        shots: Whether the line says how many labelled presses of the tested sensor the model was
            shown.
        regime: Whether the line says in which regime the model was trained.
    """
    text = model_text(record) if shots else record.model.text(without=MIXING)
    if record.encoder is not None:
        text += f" + {record.encoder.text()}"
    if share := mixing_of(record):
        text += f", mixing {share:g}"
    return f"{text} ({record.regime})" if regime else text


def trained_on(record: Record) -> str:
    """Return the training sensor of a model that was tested on another one; "" for the same."""
    test = record.test_sensor
    return "" if test is None else test.trained_on or ""


@dataclass(frozen=True)
class FittedFrames:
    """Labelled frames of the tested recording to which something else than the model was fitted.

    Attributes:
        simulator: Frames to which the simulated sensor of the training was fitted.
        labels: Frames to which offset and pivot of the labels were fitted; None: by an older run,
            which does not say.
    """

    simulator: int
    labels: int | None

    @property
    def known(self) -> int:
        """Sum of the known numbers; a frame that served both is counted twice."""
        return self.simulator + (self.labels or 0)


def fitted_frames(record: Record) -> FittedFrames | None:
    """Return what was fitted to the tested sensor; None for a model that was trained on it."""
    seen, test = record.data.of_tested_sensor, record.test_sensor
    if seen is None or test is None or not test.trained_on:
        return None
    fit = seen.described.get("label_fit")
    labels: int | None = 0
    if isinstance(fit, Mapping):
        labels = int(fit["presses"])
    elif seen.described.get("pivot_mm") not in (None, test.parameters.get("pivot_mm")):
        labels = None  # a pivot other than the given one was fitted
    return FittedFrames(seen.left_out_calibrated, labels)


def command_options(record: Record) -> str:
    """Return the options that select the test of a run, such as " --test reference", or "".

    Labelled presses are left out: they are no part of the test, and a row says how many were shown.
    """
    test = record.test_sensor
    options = [] if test is None else [o for o in test.options if not o.startswith(f"{SHOTS}=")]
    return "".join(" --hidden-seed" if text == "hidden" else f" --test {text}" for text in options)


def training_instances(record: Record) -> int:
    """Return how many sensors of one make pressed the training frames; 0 for the sensor alone."""
    count = record.sensor.parameters.get("instances", 0)
    return count if isinstance(count, int) and count > 1 else 0


def measured_on(record: Record) -> str:
    """Return "simulated sensor tactip-127", with the test sensor where that is another one."""
    test = record.test_sensor
    if test is not None and test.trained_on:
        return f"real {test.description}, trained on {test.trained_on}"
    text = f"{record.sensor.origin} sensor {record.sensor.place}"
    if count := training_instances(record):
        text += f", trained on {count} instances"
    return text if test is None else f"{text}, tested on {test.description}"


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
        censored: "<" or ">" where the value is only a limit.
    """

    value: float
    low: float | None
    high: float | None
    sd: float | None
    clusters: tuple[int, int]
    unit: str
    censored: str | None = None


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
    def mixing(self) -> float:
        """Frames mixed out of single presses for every training frame."""
        return mixing_of(self.first)

    @property
    def prior(self) -> str:
        """Prior knowledge of contacts that press together, and how many frames were mixed."""
        share = f", mixing {self.mixing:g}" if self.mixing else ""
        return prior_of(self.first) + share

    @property
    def presses(self) -> int | None:
        """Presses that the model was allowed to learn from; None for all."""
        return self.first.limits.presses

    @property
    def trivial(self) -> bool:
        """True for a model that learns next to nothing."""
        return self.first.model.name in TRIVIAL

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

        None where a seed has no value, because the other seeds alone could look too good.
        """
        rows = [row for record in self.records if (row := record.metric(metric, group))]
        values = [row.value for row in rows if row.value is not None]
        if not values or len(values) < len(self.records):
            return None
        marks = {row.censored for row in rows if row.censored}
        if len(marks) > 1:
            return None
        counts = [row.clusters for row in rows]
        return PooledMetric(
            statistics.fmean(values),
            _mean_or_none([row.low for row in rows]),
            _mean_or_none([row.high for row in rows]),
            _deviation(values) if len(values) > 1 and not marks else None,
            (min(counts), max(counts)),
            rows[0].unit,
            next(iter(marks), None),
        )

    def over(self, quantity: Callable[[Record], float | None]) -> list[float]:
        """Return a quantity of every seed that has it."""
        return [value for record in self.records if (value := quantity(record)) is not None]


def _deviation(values: Sequence[float]) -> float:
    """Return the sample standard deviation; that of ``statistics`` is a hundred times slower.

    Differences from the first value are summed, so that the result is 0 for equal values.
    """
    away = [value - values[0] for value in values]
    squares = math.fsum(gap * gap for gap in away) - math.fsum(away) ** 2 / len(away)
    return math.sqrt(max(0.0, squares) / (len(away) - 1))


def _mean_or_none(ends: Sequence[float | None]) -> float | None:
    given = [end for end in ends if end is not None]
    return statistics.fmean(given) if given and len(given) == len(ends) else None
