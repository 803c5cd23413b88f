"""Real recordings on one page: how far each model is off on each, beside guessing the mean.

Errors of different recordings have different units and ranges. So an error is also given as a share
of that of ``mean``, which answers the mean of the training labels: 1 is guessing. Whether simulated
boards predict the order of models on a recording is told by Kendall's tau, from 1 (the same order)
over 0 (no relation) to -1 (the opposite).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau

from tactibench.board.ranking import unseen_error
from tactibench.board.rows import (
    TRIVIAL,
    PooledMetric,
    Row,
    command_options,
    label_of,
    trained_on,
    whole,
)
from tactibench.board.sections import Section, sections_of
from tactibench.protocols import Ranking, RealLine, board_spec, load_protocol, real_spec
from tactibench.records import Record

REFERENCE = " --test reference"
GUESS = "mean"
"""Model that answers the mean of the training labels."""
DRAWS = 1000
"""Drawn orders behind an interval."""
NORMAL = 1.96
"""Half the width of a 95 % interval, in standard errors."""
FEWEST_MODELS, FEWEST_PRESSES = 4, 5
"""Fewer models have so few orders that any tau is chance: three models have six. An order over
fewer presses (or sensors, where several press) is theirs: others would give another."""


@dataclass(frozen=True)
class RealTest:
    """An error on the test presses of a real recording, and the models that answered them.

    Attributes:
        line: The error.
        recording: Name of the tested recording.
        trained_on: What the models were trained on where it is something else; "" otherwise.
        shots: Number of labelled presses of the tested sensor that they were shown.
        rows: Name of a model -> its row at the default settings.
    """

    line: RealLine
    recording: str
    trained_on: str
    shots: int
    rows: Mapping[str, Row]

    def error(self, model: str) -> PooledMetric | None:
        """Return the error of a model; None where it has none."""
        row = self.rows.get(model)
        return None if row is None else row.metric(self.line.metric, self.line.group)

    def share(self, model: str) -> float | None:
        """Return the error of a model over that of guessing; None where one is not known."""
        error, guess = self.error(model), self.error(GUESS)
        return None if error is None or not guess or not guess.value else error.value / guess.value

    @property
    def order(self) -> Order:
        """Model -> error, without trivial models."""
        errors = {model: self.error(model) for model in self.rows if model not in TRIVIAL}
        return {model: error for model, error in errors.items() if error is not None}


Order = Mapping[str, PooledMetric]
"""Model -> its error on a board, without trivial models."""


@dataclass(frozen=True)
class Agreement:
    """Kendall's tau between the orders of models on two boards.

    Attributes:
        tau: From -1 to 1.
        low: Lower end of its 95 % interval over presses and training seeds, for these models.
        high: Upper end.
        models: Number of models that both boards have.
    """

    tau: float
    low: float
    high: float
    models: int


def agreement(one: Order, other: Order) -> Agreement | None:
    """Return how far two orders of models agree; None with fewer than FEWEST_MODELS in common.

    The interval is that of 1,000 drawn pairs of orders, in which every error varies normally by
    the standard error that its interval and the spread of its seeds tell.
    """
    both = sorted(one.keys() & other.keys())
    if len(both) < FEWEST_MODELS:
        return None
    errors = [[order[name].value for name in both] for order in (one, other)]
    spread = [[_standard_error(order[name]) for name in both] for order in (one, other)]
    rng = np.random.default_rng(0)
    drawn = rng.normal(errors, spread, (DRAWS, 2, len(both)))
    i, j = np.triu_indices(len(both), 1)
    taus = np.sign(drawn[..., i] - drawn[..., j]).prod(axis=1).mean(axis=-1)  # no ties
    low, high = np.quantile(taus, [0.025, 0.975])
    return Agreement(float(kendalltau(*errors).statistic), float(low), float(high), len(both))


def _standard_error(error: PooledMetric) -> float:
    """Return the standard error of a mean over presses and seeds; 0 where nothing is known."""
    width = 0.0 if error.low is None or error.high is None else error.high - error.low
    seeds = (error.sd or 0.0) / math.sqrt(error.seeds)
    return math.hypot(width / (2 * NORMAL), seeds)


def real_tests(records: Mapping[str, Iterable[Record]]) -> list[RealTest]:
    """Return the tests on real recordings, in the order of the page's lines.

    Args:
        records: Records of the present version of each protocol, by its id.
    """
    lines = real_spec().lines
    return [
        RealTest(
            line,
            _recording(section.record),
            _named(trained_on(section.record)),
            shots,
            _default_rows(section.rows, shots),
        )
        for protocol in dict.fromkeys(line.protocol for line in lines)
        for section in sections_of(whole(records.get(protocol, ())))
        if section.origin == "real"
        for line in lines
        if line.protocol == protocol
        for shots in sorted({row.first.shots for row in section.rows})
    ]


def _recording(record: Record) -> str:
    """Return the name of the tested recording."""
    if record.test_sensor is not None:
        return _named(record.test_sensor.description)
    recording = record.sensor.recording
    if recording is None:
        return record.sensor.name
    return real_spec().names.get(recording.sha256[:8], recording.sensor or recording.label)


def recording_title(record: Record) -> str:
    """Return the heading of a table of a real recording, and what the models were trained on."""
    trained = trained_on(record)
    also = f", trained on {_named(trained)}" if trained else ""
    return f"Real recording: {_recording(record)}{also}"


def _named(description: str) -> str:
    """Return the name of a recording that is described by its folder, such as "recording a/b"."""
    return real_spec().names.get(description.rpartition("recording ")[2], description)


def _default_rows(rows: Iterable[Row], shots: int = 0) -> dict[str, Row]:
    """Return the rows of models and encoders at their defaults, by the name of the model.

    They are of the first regime of the protocol, which is that of single contacts.

    Args:
        rows: Rows of one table.
        shots: Number of labelled presses that a model was shown; guessing is shown none.
    """
    chosen: dict[str, Row] = {}
    for row in rows:
        name = row.first.model.name
        shown = row.first.shots if name != GUESS else shots
        if label_of(row.first, shots=False) == name and shown == shots:
            chosen.setdefault(name, row)
    return chosen


def simulated_orders(records: Iterable[Record]) -> dict[str, Order]:
    """Return the orders of models on simulated presses of the leading protocol, by their names.

    These are the sensor of the training, sensors that no training saw, and scenes that finite
    elements pressed.

    Args:
        records: Records of that protocol.
    """
    protocol = load_protocol(real_spec().simulated)
    spec, unseen = board_spec(protocol.spec.id), unseen_error(protocol)
    main, depth = spec.ranking, spec.depth
    orders: dict[str, Order] = {}
    for section in sections_of(whole(records)):
        if section.origin != "simulated" or main is None:
            continue
        if section.nominal:
            orders.setdefault("the simulated sensor of the training", _order(section, main))
            if depth is not None:  # which is what plates are ordered by
                orders.setdefault("the same, by the depth alone", _order(section, depth))
            if unseen is not None:
                orders.setdefault("simulated sensors that no training saw", _order(section, unseen))
        elif not section.sensor.changed and command_options(section.record) == REFERENCE:
            orders.setdefault("scenes by finite elements", _order(section, main))
    return orders


def _order(section: Section, error: Ranking) -> Order:
    rows = _default_rows(section.rows)
    errors = {name: row.metric(error.metric, error.group) for name, row in rows.items()}
    return {
        name: value
        for name, value in errors.items()
        if value is not None and value.clusters[0] >= FEWEST_PRESSES and name not in TRIVIAL
    }
