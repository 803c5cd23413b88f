"""The name of a run on a board, and what two runs must share, read from its record alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tactibench.records.record import Record, Value

MIXING = "mixing"
"""The parameter of a model that trains on contacts mixed out of single presses."""
RETIRED = frozenset({"tolerance", "allow_fem"})
"""Parameters of simulated sensors in older records, which changed none of their frames."""
TRIVIAL = frozenset({"mean", "nearest"})
"""Models that learn next to nothing: what any other has to beat."""


def mixing_of(record: Record) -> str:
    """Return the frames mixed out of single presses for every training frame, "" for none."""
    share = record.model.parameters.get(MIXING)
    return f"{share:g}" if isinstance(share, int | float) and share > 0 else ""


def label_of(record: Record) -> str:
    """Return model, encoder where there is one, mixing and regime, in one line."""
    text = record.model.text(without=MIXING)
    if record.encoder is not None:
        text += f" + {record.encoder.text()}"
    if mixing := mixing_of(record):
        text += f", mixing {mixing}"
    return f"{text} ({record.regime})"


def row_key(record: Record) -> list[Any]:
    """Return all that two records must share to be seeds of one row, as JSON values."""
    encoder = None if record.encoder is None else record.encoder.identity
    model = record.model.identity
    return [section_key(record), model, encoder, record.regime, record.limits.presses]


def section_key(record: Record) -> list[Any]:
    """Return all that two records must share to stand in one table, as JSON values.

    These are the question, the sensor and the test frames.
    """
    sensor, test = record.sensor, record.test_sensor
    key = [
        record.protocol.id,
        record.protocol.hash,
        sensor.origin,
        sensor.name,
        _lasting(sensor.parameters),
        record.identity.data,
    ]
    if test is None:
        return key
    key += [test.name, _lasting(test.parameters)]
    return [*key, test.trained_on] if test.trained_on else key


def _lasting(parameters: Mapping[str, Value]) -> dict[str, Value]:
    return {name: value for name, value in parameters.items() if name not in RETIRED}


def trained_on(record: Record) -> str:
    """Return the sensor of a model that was tested on another one; "" where on the same."""
    test = record.test_sensor
    return "" if test is None else test.trained_on or ""


def command_options(record: Record) -> str:
    """Return the options that ask for what a run was tested on: " --test reference", or ""."""
    test = record.test_sensor
    options = [] if test is None else test.options
    return "".join(" --hidden-seed" if text == "hidden" else f" --test {text}" for text in options)


def measured_on(record: Record) -> str:
    """Return "simulated sensor tactip-127", and what it was tested on where that is another."""
    test = record.test_sensor
    if test is not None and test.trained_on:
        return f"real {test.description}, trained on {test.trained_on}"
    text = f"{record.sensor.origin} sensor {record.sensor.name}"
    return text if test is None else f"{text}, tested on {test.description}"


def trained_for(records: Iterable[Record]) -> list[Record]:
    """Return those that were tested on the sensor that they were trained for."""
    return [record for record in records if record.test_sensor is None]


def whole(records: Iterable[Record]) -> list[Record]:
    """Return those that learned from all presses; the others belong to a learning curve alone."""
    return [record for record in records if record.limits.presses is None]
