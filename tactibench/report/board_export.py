"""The boards as tidy rows for other programs; their first tables for papers and terminals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactibench.board import (
    Errors,
    Ranks,
    Row,
    Section,
    all_press_errors,
    by_machine,
    frames_per_second,
    latency,
    machine,
    ordered,
    prior_of,
    ranks,
    read_submissions,
    sections_of,
    whole,
)
from tactibench.protocols import Block as BoardTable
from tactibench.protocols import LoadedProtocol, load_protocol, protocol_files
from tactibench.protocols.board_spec import board_spec
from tactibench.records import Record
from tactibench.report.board_tables import metric_blocks
from tactibench.report.numbers import fixed
from tactibench.report.table import Cell, Column, Head, Number, Table, Text, metric_number, table
from tactibench.report.writers.csv import csv_text
from tactibench.report.writers.latex import latex_text

COSTS: tuple[tuple[str, str, Callable[[Record], float | None]], ...] = (
    ("p90_ms", "ms", lambda record: latency(record, threads=1)),
    ("frames_per_s", "1/s", frames_per_second),
    ("parameters", "", lambda record: record.efficiency.parameters),
    ("flops", "", lambda record: record.efficiency.flops_per_frame),
    ("peak_memory_mb", "MB", lambda record: record.efficiency.peak_memory_mb),
    ("training_s", "s", lambda record: record.training.seconds),
)

LATEX_NOTE = r"mean over seeds [95\,\% interval over presses]"


def tidy_rows(board: Path) -> list[dict[str, Any]]:
    """Return one line for every board, row and metric: rank, mean over seeds, interval, counts.

    Costs have their own lines, one for every machine that a row was timed on.
    """
    return [line for protocol in _protocols() for line in protocol_rows(board, protocol)]


def protocol_rows(board: Path, protocol: LoadedProtocol) -> list[dict[str, Any]]:
    """Return one line for every row and metric of one board, as ``tidy_rows``."""
    lines, name = [], protocol.spec.id
    sections, errors = _sections(board, protocol)
    for section in sections:
        ranked = ranks(name, section.rows, errors)
        for k, row in enumerate(section.rows):
            rank = None if ranked is None else ranked.by_row[k]
            lines += [{**line, "rank": rank} for line in _lines(name, section, row)]
    return lines


def _protocols() -> list[LoadedProtocol]:
    return [load_protocol(name) for name in protocol_files()]


def board_csv(lines: list[dict[str, Any]]) -> str:
    """Return tidy rows as CSV; the items of a list are separated by spaces."""
    heads = list(dict.fromkeys(key for line in lines for key in line))
    return csv_text(table(heads, [[_cell(line.get(head)) for head in heads] for line in lines]))


def board_latex(board: Path) -> str:
    """Return the first table of every section of every board, as LaTeX."""
    texts = []
    for protocol in _protocols():
        for first, signatures in first_tables(board, protocol):
            texts.append(latex_text(replace(first, note=LATEX_NOTE), signatures))
    return "\n".join(texts)


def first_tables(board: Path, protocol: LoadedProtocol) -> Iterator[tuple[Table, list[str]]]:
    """Yield the first table of every section of one board, with the signatures of its runs."""
    name = protocol.spec.id
    sections, errors = _sections(board, protocol)
    for section in sections:
        rows = ordered(name, section.rows)
        title = f"{name}, {section.title}"
        signatures = [record.signature for row in rows for record in row.records]
        block = metric_blocks(board_spec(name), rows)[0]
        yield _first_table(title, rows, block, ranks(name, rows, errors)), signatures


def _sections(board: Path, protocol: LoadedProtocol) -> tuple[list[Section], Errors]:
    records = read_submissions(board, protocol.spec.id)
    return sections_of(whole(records)), all_press_errors(board, records)


def _first_table(title: str, rows: list[Row], spec: BoardTable, ranked: Ranks | None) -> Table:
    numbers = (None,) * len(rows) if ranked is None else ranked.by_row
    heads: list[Head] = [
        Column(""),
        *("model", "encoder", "regime", "prior knowledge"),
        Column("seeds"),
        *(Column(column.head) for column in spec.columns),
    ]
    body: list[list[Cell]] = []
    for rank, row in zip(numbers, rows, strict=True):
        metrics = (
            metric_number(row.metric(c.metric, c.group), c.decimals, interval=c.interval)
            for c in spec.columns
        )
        body.append(
            [
                None if rank is None else Number(rank, fixed(0)),
                Text(row.model, "italic" if row.trivial else ""),
                row.encoder or None,
                row.regime,
                row.prior,
                str(len(row.records)),
                *metrics,
            ]
        )
    note = "mean over seeds [95 % interval over presses]"
    if any(row.trivial for row in rows):
        note += "; trivial models stand last, whatever their rank"
    return table(heads, body, title=title, note=note)


def _cell(value: Any) -> Cell:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, list):
        return " ".join(map(str, value))
    return Number(value, str)


def _lines(protocol: str, section: Section, row: Row) -> list[dict[str, Any]]:
    subject = {
        "protocol": protocol,
        "sensor": section.title,
        "model": row.model,
        "encoder": row.encoder or None,
        "regime": row.regime,
        "prior": prior_of(row.first),
        "mixing": row.mixing or None,
        "seeds": list(row.seeds),
    }
    lines = []
    for metric, group in dict.fromkeys((m.metric, m.group) for r in row.records for m in r.metrics):
        pooled = row.metric(metric, group)
        if pooled is not None:
            facts = {
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
            lines.append(subject | facts)
    for part in by_machine(row):
        for metric, unit, quantity in COSTS:
            if values := part.over(quantity):
                facts = {
                    "seeds": list(part.seeds),
                    "metric": metric,
                    "group": machine(part.first),
                    "value": sum(values) / len(values),
                    "unit": unit,
                }
                lines.append(subject | facts)
    return lines
