"""The boards as a tidy list, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactibench.board.cost import (
    by_machine,
    frames_per_second,
    memory,
    operations,
    parameters,
    training_seconds,
)
from tactibench.board.labels import whole
from tactibench.board.rows import Row, latency, machine
from tactibench.board.sections import Section, sections_of
from tactibench.board.submissions import read_submissions
from tactibench.protocols.loader import protocol_files

COSTS = (
    ("p90_ms", "ms", lambda record: latency(record, threads=1)),
    ("frames_per_s", "1/s", frames_per_second),
    ("parameters", "", parameters),
    ("flops", "", operations),
    ("peak_memory_mb", "MB", memory),
    ("training_s", "s", training_seconds),
)


def tidy_rows(board: Path) -> list[dict[str, Any]]:
    """Of every board, row and metric: mean over seeds, interval, spread, counts."""
    return [
        row
        for name in protocol_files()
        for section in sections_of(whole(read_submissions(board, name)))
        for pooled in section.rows
        for row in _rows(name, section, pooled)
    ]


def _rows(protocol: str, section: Section, row: Row) -> list[dict[str, Any]]:
    who = {"protocol": protocol, "sensor": section.title, "model": row.model,
           "encoder": row.encoder or None, "regime": row.regime, "mixing": row.mixing or None,
           "seeds": list(row.seeds)}  # fmt: skip
    found = []
    pairs = dict.fromkeys((m["metric"], m["group"]) for r in row.records for m in r["metrics"])
    for metric, group in pairs:
        pooled = row.metric(metric, group)
        if pooled is not None:
            found.append({**who, "metric": metric, "group": group, "value": pooled.value,
                          "unit": pooled.unit, "low": pooled.low, "high": pooled.high,
                          "sd": pooled.sd, "clusters": list(pooled.clusters),
                          "censored": pooled.censored})  # fmt: skip
    for part in by_machine(row):
        for metric, unit, quantity in COSTS:
            values = part.over(quantity)
            if values:
                found.append({**who, "seeds": list(part.seeds), "metric": metric,
                              "group": machine(part.first), "value": sum(values) / len(values),
                              "unit": unit})  # fmt: skip
    return found
