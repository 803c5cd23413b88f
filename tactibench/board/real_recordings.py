"""Real recordings on one page: how far each model is off on each, beside guessing the mean.

Errors of different recordings have different units and ranges. So an error is also given as a share
of that of ``mean``, which answers the mean of the training labels: 1 is guessing. Whether simulated
boards predict the order of models on a recording is told by Kendall's tau, from 1 (the same order)
over 0 (no relation) to -1 (the opposite).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from scipy.stats import kendalltau

from tactibench.board.rows import TRIVIAL, PooledMetric, Row, trained_on, whole
from tactibench.board.sections import sections_of
from tactibench.protocols import RealLine, board_spec, load_protocol, real_spec
from tactibench.records import Record

GUESS = "mean"
"""Model that answers the mean of the training labels."""
FEWEST_MODELS = 4
"""Fewer models have so few orders that any tau is chance: three models have six."""


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
    def order(self) -> dict[str, float]:
        """Model -> error, without trivial models."""
        errors = {model: self.error(model) for model in self.rows if model not in TRIVIAL}
        return {model: error.value for model, error in errors.items() if error is not None}


@dataclass(frozen=True)
class Agreement:
    """Kendall's tau between the orders of models on two boards, trivial models left out.

    Attributes:
        tau: From -1 to 1.
        models: Number of models that both boards have.
    """

    tau: float
    models: int


def agreement(one: Mapping[str, float], other: Mapping[str, float]) -> Agreement | None:
    """Return how far two orders of models agree; None with fewer than FEWEST_MODELS in common.

    Args:
        one: Model -> error.
        other: Model -> error.
    """
    both = sorted(one.keys() & other.keys())
    if len(both) < FEWEST_MODELS:
        return None
    tau = kendalltau([one[name] for name in both], [other[name] for name in both]).statistic
    return Agreement(float(tau), len(both))


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
            _default_rows(protocol, section.rows, shots),
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


def _named(description: str) -> str:
    """Return the name of a recording that is described by its folder, such as "recording a/b"."""
    return real_spec().names.get(description.rpartition("recording ")[2], description)


def _default_rows(protocol: str, rows: Iterable[Row], shots: int = 0) -> dict[str, Row]:
    """Return the rows of models and encoders at their defaults, by the name of the model.

    They are of the first regime of the protocol, which is that of single contacts.

    Args:
        protocol: Id of the protocol.
        rows: Rows of one table.
        shots: Number of labelled presses that a model was shown; guessing is shown none.
    """
    spec = load_protocol(protocol).spec
    encoder, regime = spec.defaults.encoder, next(iter(spec.regimes))
    chosen: dict[str, Row] = {}
    for row in rows:
        model = row.first.model
        default = not model.changed and row.encoder in {"", encoder, model.name}
        shown = row.first.shots if model.name != GUESS else shots
        if default and row.regime == regime and shown == shots:
            chosen.setdefault(model.name, row)
    return chosen


def simulated_order(records: Iterable[Record], group: str) -> dict[str, float]:
    """Return model -> error on the nominal simulated sensor of the leading protocol.

    Args:
        records: Records of that protocol.
        group: Group of the metric: that of the nominal test, or of unseen sensors.
    """
    spec = real_spec()
    ranking = board_spec(spec.simulated).ranking
    if ranking is None:
        return {}
    for section in sections_of(whole(records)):
        if section.origin == "simulated" and section.nominal:
            rows = _default_rows(spec.simulated, section.rows)
            errors = {name: row.metric(ranking.metric, group) for name, row in rows.items()}
            return {
                name: error.value
                for name, error in errors.items()
                if error is not None and name not in TRIVIAL
            }
    return {}
