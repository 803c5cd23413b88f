"""The boards as a tidy list, for other programs, and as LaTeX, for a paper."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactibench.board.columns import BLOCKS
from tactibench.board.cost import (
    by_machine,
    frames_per_second,
    memory,
    operations,
    parameters,
    training_seconds,
)
from tactibench.board.labels import whole
from tactibench.board.latex import latex_table
from tactibench.board.ranking import ordered
from tactibench.board.ranks import Errors, ranks
from tactibench.board.rows import Row, latency, machine
from tactibench.board.sections import Section, sections_of
from tactibench.board.submissions import all_press_errors, read_submissions
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
    """Of every board, row and metric: rank, mean over seeds, interval, spread, counts."""
    found = []
    for name, sections, errors in _boards(board):
        for section in sections:
            ranked = ranks(name, section.rows, errors)
            for k, row in enumerate(section.rows):
                rank = None if ranked is None else ranked.by_row[k]
                found += [{**line, "rank": rank} for line in _rows(name, section, row)]
    return found


def csv_text(rows: list[dict[str, Any]]) -> str:
    """The same as a table with a line a metric; lists are written with spaces between."""
    heads = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, heads, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(
            {
                key: " ".join(map(str, value)) if isinstance(value, list) else _inert(value)
                for key, value in row.items()
            }
        )
    return text.getvalue()


def latex_text(board: Path) -> str:
    """The first table of every section of every board."""
    found = []
    for name, sections, errors in _boards(board):
        for section in sections:
            if name in BLOCKS:
                rows = ordered(name, section.rows)
                title = f"{name}, {section.title}"
                ranked = ranks(name, rows, errors)
                found.append(latex_table(title, rows, BLOCKS[name][0].columns, ranked))
    return "\n".join(found)


def _boards(board: Path) -> Iterator[tuple[str, list[Section], Errors]]:
    for name in protocol_files():
        records = read_submissions(board, name)
        yield name, sections_of(whole(records)), all_press_errors(board, records)


def _inert(value: Any) -> Any:
    """Text that no spreadsheet takes for a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@") else value


def _rows(protocol: str, section: Section, row: Row) -> list[dict[str, Any]]:
    who = {
        "protocol": protocol,
        "sensor": section.title,
        "model": row.model,
        "encoder": row.encoder or None,
        "regime": row.regime,
        "mixing": row.mixing or None,
        "seeds": list(row.seeds),
    }
    found = []
    pairs = dict.fromkeys((m.metric, m.group) for r in row.records for m in r.metrics)
    for metric, group in pairs:
        pooled = row.metric(metric, group)
        if pooled is not None:
            found.append(
                {
                    **who,
                    "metric": metric,
                    "group": group,
                    "value": pooled.value,
                    "unit": pooled.unit,
                    "low": pooled.low,
                    "high": pooled.high,
                    "sd": pooled.sd,
                    "clusters": list(pooled.clusters),
                    "censored": pooled.censored,
                }
            )
    for part in by_machine(row):
        for metric, unit, quantity in COSTS:
            values = part.over(quantity)
            if values:
                found.append(
                    {
                        **who,
                        "seeds": list(part.seeds),
                        "metric": metric,
                        "group": machine(part.first),
                        "value": sum(values) / len(values),
                        "unit": unit,
                    }
                )
    return found
