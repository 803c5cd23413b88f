"""Records sorted into the rows and sections of boards: seeds of one row share all but the seed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from tactibench.board.rows import Row, label_of
from tactibench.records import Record, canonical, digest


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
    return sorted(rows, key=lambda row: (row.first.shots, row.label, row.presses or 0))


def row_on_own_test(row: Row, records: Iterable[Record]) -> Row | None:
    """Return the row of the same weights on the protocol's own test; None where a seed lacks it.

    Args:
        row: Row of models that were tested on something else: hidden presses, finite elements,
            another sensor.
        records: All records of the same version of the protocol.
    """
    weights = [_weights(record) for record in row.records]
    on_own_test = [record for record in trained_for(records) if _weights(record) in weights]
    return Row(tuple(on_own_test)) if len(on_own_test) == len(row.records) else None


def _weights(record: Record) -> list[Any]:
    # The hash alone cannot tell apart decoders of one map, nor sensors with equal labels.
    encoder = None if record.encoder is None else record.encoder.identity
    return [*training_sensor(record), encoder, record.regime, record.identity.weights_hash]


def _mark(record: Record, labels: Mapping[tuple[str, int | None], int]) -> str:
    return f" #{digest(row_key(record))[:4]}" if labels[_shown(record)] > 1 else ""


def _shown(record: Record) -> tuple[str, int | None]:
    return label_of(record), record.limits.presses
