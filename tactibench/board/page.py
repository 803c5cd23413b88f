"""The page of one protocol: a pure function of the committed records and published tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from types import MappingProxyType

from tactibench.board.columns import BLOCKS, Block, Column
from tactibench.board.cost import cost_lines
from tactibench.board.curve import curve_lines, curves
from tactibench.board.hard_cases import hard_case_lines
from tactibench.board.labels import (
    TRIVIAL,
    command_options,
    section_key,
    trained_on,
    whole,
)
from tactibench.board.markdown import code, details, plain
from tactibench.board.printed import published_lines
from tactibench.board.published import PublishedTable
from tactibench.board.ranking import RANKING, ordered
from tactibench.board.ranks import Errors, ranks
from tactibench.board.rows import Row, rows_of
from tactibench.board.sections import Section, sections_of
from tactibench.board.tables import block_lines
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.record import Record

READING = """\
Each table holds one sensor: simulated and real never share a column. A row is a model with its
parameters (those that are not at their defaults), encoder and training regime, its training seeds
pooled. Values are means over seeds; below them, the mean of the seeds' 95 % intervals over presses.
`sd`: standard deviation over training seeds, which is not part of the interval. `mixing`: frames
that a model made for itself out of single presses, per training frame. Models in italics are
trivial. `n/a`: not measured, or one seed has no value."""


def page(
    protocol: LoadedProtocol,
    records: Sequence[Record],
    published: Sequence[PublishedTable],
    errors: Errors = MappingProxyType({}),
) -> str:
    """Markdown of a board. records: committed ones of this protocol, of any version.

    errors: press by press, of the records that have answers beside them.
    """
    name = protocol.keys.id
    lines = [
        f"# {name}: {protocol.keys.title}",
        "",
        "<!-- Made by `tactibench board` from submissions/ and published/; do not edit. -->",
        "",
        *READING.split("\n"),
        "",
        *_order(name),
    ]
    sections = sections_of(whole(records))
    for section in sections:
        lines += _section(name, section, protocol, records, errors)
    if not sections:
        lines += [
            f"No run has been added yet: `tactibench board add RUN` adds one of {name}.",
            "",
        ]
    lines += published_lines(name, published)
    return "\n".join(lines).rstrip("\n") + "\n"


def _order(protocol: str) -> list[str]:
    if protocol not in RANKING:
        return []
    text = (
        f"Rows are ordered by {RANKING[protocol].name}, trivial ones last. The order is no rank: "
        "rows that cannot be told apart share one."
    )
    return [text, ""]


def _section(
    name: str,
    section: Section,
    protocol: LoadedProtocol,
    records: Iterable[Record],
    errors: Errors,
) -> list[str]:
    stated = section.record.protocol
    rows = ordered(name, section.rows)
    lines = [f"## {plain(section.title)}", ""]
    if stated.hash != protocol.hash:
        lines += [
            f"Made with version {stated.version} of the protocol (`{stated.hash[:8]}`),"
            f" which is not the present one (`{protocol.hash[:8]}`).",
            "",
        ]
    lines += _tested(section.record)
    lines += _account(section.record)
    ranked = ranks(name, rows, errors)
    for k, block in enumerate(BLOCKS.get(name) or (_all_metrics(rows),)):
        lines += block_lines(block, rows, None if k else ranked)
    lines += hard_case_lines(rows, protocol.keys.axes)
    if name in RANKING:
        here = [r for r in records if section_key(r) == section_key(section.record)]
        lines += curve_lines(curves(rows_of(here), RANKING[name]), RANKING[name])
    timed = any(record.speed for row in rows for record in row.records)
    if timed and (section.record.test_sensor is None or trained_on(section.record)):
        lines += cost_lines(rows)  # elsewhere the same weights cost the same
    lines += _missing_trivial(name, rows)
    runs = [record for row in rows for record in row.records]
    lines += _code(runs)
    signatures = (record.signature for record in runs)
    plural = "s" if len(runs) > 1 else ""
    return [*lines, *details(f"Signature{plural} of {len(runs)} run{plural}", signatures), ""]


def _tested(record: Record) -> list[str]:
    """How many frames of how many presses, where they are not those of the protocol's draws."""
    test = record.test_sensor
    if test is None:
        return []
    frames, presses = record.data.test, test.presses
    counted = f"{presses:,} presses"
    if frames != presses:
        counted = f"{frames:,} frames of {counted}"
    if trained := trained_on(record):
        seen = record.data.of_tested_sensor
        left = 0 if seen is None else seen.left_out_calibrated
        fitted = f" {left:,} frames to which the simulator was fitted test nothing." if left else ""
        return [
            f"Trained on {plain(trained)}, tested on {counted} of another sensor, of which a "
            "model is given the rest image and as many labelled frames as a column says, none "
            f"of them a test press.{fitted}",
            "",
        ]
    options = code(command_options(record)[1:])
    return [f"Trained on the sensor itself and tested on {counted}: {options}.", ""]


def _account(record: Record) -> list[str]:
    """How the sensor made the test scenes, where it made them in more than one way."""
    counts = record.sensor.scene_counts.get("test", {})
    made = ", ".join(f"{count:,} {plain(way)}" for way, count in sorted(counts.items()))
    return [f"Test scenes: {made}.", ""] if made else []


def _code(runs: Sequence[Record]) -> list[str]:
    """The commits that the runs were made with, and whether files had been changed since."""
    commits = Counter(record.identity.commit for record in runs)
    made = []
    for commit, count in sorted(commits.items()):
        name, plus, _ = commit.partition("+")
        changed = ", with uncommitted changes" if plus else ""
        made.append(f"{code(name[:10])}{changed} ({count})")
    return [f"Runs by commit of tactibench: {'; '.join(made)}.", ""]


def _missing_trivial(name: str, rows: Sequence[Row]) -> list[str]:
    """A board without its trivial rows says how to make them."""
    there = {row.first.model.name for row in rows}
    absent = sorted(TRIVIAL - there)
    if trained_on(rows[0].first):  # the board does not know where the recordings lie
        return []
    asked = "".join({command_options(row.first) for row in rows})
    made = " and ".join(f"`tactibench run {name} --model {model}{asked}`" for model in absent)
    return [f"Trivial rows are missing: {made} on this sensor.", ""] if made else []


def _all_metrics(rows: Sequence[Row]) -> Block:
    """The table of a protocol that has no tables of its own."""
    names = dict.fromkeys(
        metric.metric for row in rows for record in row.records for metric in record.metrics
    )
    return Block("Metrics", tuple(Column(name, "all", plain(name), 4) for name in names))
