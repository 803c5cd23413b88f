"""The page of a board: a function of the committed records and published tables.

The Markdown pages under ``leaderboards/`` and the chapters of the HTML report show the same tables.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tactibench.board import (
    BELOW_BOUND,
    TRIVIAL,
    Curve,
    Errors,
    Row,
    Section,
    all_press_errors,
    by_machine,
    check_folder,
    command_options,
    committed_protocols,
    curves,
    fitted_frames,
    frames_per_second,
    latency,
    machine,
    ordered,
    prior_of,
    ranks,
    read_submissions,
    row_on_own_test,
    rows_of,
    section_key,
    sections_of,
    trained_on,
    whole,
)
from tactibench.errors import UserError
from tactibench.protocols import (
    LoadedProtocol,
    PublishedTable,
    board_spec,
    load_protocol,
    protocol_files,
    published_for,
)
from tactibench.protocols.loader import VARIABLE
from tactibench.records import Record, atomic, canonical, training_instances
from tactibench.report.board_tables import (
    BELOW,
    cost_table,
    curve_table,
    hard_case_tables,
    metric_blocks,
    metric_table,
    own_test_table,
    published_table,
)
from tactibench.report.pages import render
from tactibench.report.real_page import real_page
from tactibench.report.run_view import error_line
from tactibench.report.tables import Table
from tactibench.shipped import shipped_folder

READING = (
    "A table holds one sensor: simulated and real never share a column. A row is a model with its "
    "settings (those that are not at their defaults), its encoder and, in brackets, its training "
    "regime. Its training seeds are pooled. Below its name stand its prior knowledge, the number "
    "of seeds, and whether the row was reproduced (`board reproduce`: somebody else made its runs "
    "again from their requests). A row as submitted was not: its scores are computed from its "
    "answers, and everything else is its submitter's word. Prior knowledge is what a model knew, "
    "besides the frames of its regime, of contacts that press together; mixing is how many frames "
    "it mixed out of single presses, for every training frame. Models in italics are trivial.",
    "A value is the mean over seeds. Below it stands the mean of the seeds' 95 % intervals over "
    "presses. `sd` is the standard deviation over training seeds, which is not part of the "
    "interval. `n/a`: not measured, or one seed has no value.",
    "Rows share a rank where their order may be chance, that of other presses and of other "
    "training seeds. The first row of a rank has a smaller error than each row of a later rank, at "
    "p < 0.05, adjusted for the number of comparisons (Holm). Two other rows of different ranks "
    "need not differ. A row joins the rank of a row from which it cannot be told apart. So a row "
    "whose seeds scatter can have a better rank than a row with a smaller error; the note below "
    "the table names such rows. The first table of a section counts the presses.",
    "p90: the time from one frame to its contacts in mm that nine of ten frames keep, on one "
    "thread where nothing else is said. frames/s: the best batch. *: not settled, because the time "
    "still drifted after the warm-up, or because others computed meanwhile. Compare times inside "
    "one machine only. Operations: floating-point, of one frame. Memory: peak of the whole process "
    "while it was timed. Training: a run that found its weights in the cache shows the time that "
    "they took.",
)
"""How to read the tables of every board."""
COSTS = {
    "p90_ms": ("ms", lambda record: latency(record, threads=1)),
    "frames_per_s": ("1/s", frames_per_second),
    "parameters": ("", lambda record: record.efficiency.parameters),
    "flops": ("", lambda record: record.efficiency.flops_per_frame),
    "peak_memory_mb": ("MB", lambda record: record.efficiency.peak_memory_mb),
    "training_s": ("s", lambda record: record.training.seconds),
}
"""Costs in the frame of a board -> unit, and how a record states it."""


@dataclass(frozen=True)
class PageSection:
    """The tables of one sensor.

    Attributes:
        section: Rows, sensor and test frames.
        rows: Rows of the first table, in their order.
        curves: Learning curves.
        notes: Sentences above the tables; `backticks` mark code.
        tables: All tables; the first one orders the rows.
        commits: The commits that the runs were made with.
    """

    section: Section
    rows: tuple[Row, ...]
    curves: tuple[Curve, ...]
    notes: tuple[str, ...]
    tables: tuple[Table, ...]
    commits: str

    @property
    def title(self) -> str:
        """The sensor, and the test frames where they are not its own."""
        return self.section.title

    @property
    def signatures(self) -> list[str]:
        """One line for every run, which makes its numbers reproducible."""
        return [record.signature for row in self.rows for record in row.records]


@dataclass(frozen=True)
class BoardPage:
    """A board as data of a template.

    Attributes:
        title: Title of the protocol.
        intro: How the rows are ordered, or how the first one is made.
        sections: Tables of each sensor.
        published: A table a paper; empty where no paper has a row.
        machines: Fingerprint of every machine that timed a row -> the machine in words.
    """

    title: str
    intro: str
    sections: tuple[PageSection, ...]
    published: tuple[Table, ...]
    machines: Mapping[str, str]

    def markdown(self) -> str:
        """Return the page as it stands under ``leaderboards/``.

        It is about two screens long: the first table of the first sensor is shown, all others are
        folded behind their titles.
        """
        return render("board.md.j2", page=self, reading=READING)


@dataclass(frozen=True)
class PageFile:
    """The file of a page under ``leaderboards/``: its text, and the number of its records."""

    path: Path
    text: str
    records: int

    @property
    def current(self) -> bool:
        """True if the file holds exactly this text."""
        return self.path.is_file() and self.path.read_bytes() == self.text.encode()

    def write(self) -> None:
        """Write the file, whole or not at all."""
        with atomic(self.path) as stream:
            stream.write(self.text.encode())


def page_files(board: Path) -> list[PageFile]:
    """Return the page of every protocol that has committed records, made from them.

    A page that exists already stays even without records, so that a row can be removed.

    Args:
        board: Folder of the board.

    Raises:
        UserError: There is no board, or it holds records of an unknown protocol.
    """
    check_folder(board)
    names, trained = protocol_files(), {}
    for name in committed_protocols(board):
        if name not in names:
            raise UserError(
                f"{board} holds records of protocol {name!r}, which is not installed; name the "
                f"folder of its .toml file in {VARIABLE}."
            )
    pages = []
    for name in names:
        path, records = board / f"{name}.md", read_submissions(board, name)
        if records or path.is_file():  # a laboratory shows its own protocols, not all that ship
            page = committed_page(load_protocol(name), board, records)
            pages.append(PageFile(path, page.markdown(), len(records)))
            trained[name] = records
    real = real_page(trained)
    if real.tables:
        pages.append(PageFile(board / "real.md", real.markdown(), real.records))
    return pages


def committed_page(
    protocol: LoadedProtocol, board: Path, records: Sequence[Record] | None = None
) -> BoardPage:
    """Return the page of a protocol, made from its committed records.

    Args:
        protocol: The protocol.
        board: Folder of the board.
        records: The records, where they were read already.
    """
    if records is None:
        records = read_submissions(board, protocol.spec.id)
    errors = all_press_errors(board, records)
    published = published_for(protocol.spec, published_folder(board))
    return board_page(protocol, records, published, errors)


def published_folder(board: Path) -> Path:
    """Return the folder of the published tables: the board's own, or that of the package."""
    own = board / "published"
    return own if own.is_dir() else shipped_folder("published")


def board_page(
    protocol: LoadedProtocol,
    records: Sequence[Record],
    published: Sequence[PublishedTable],
    errors: Errors = MappingProxyType({}),
) -> BoardPage:
    """Return the page of a board.

    Args:
        protocol: The protocol.
        records: Its records.
        published: Tables of papers.
        errors: Errors press by press, of the records that have predictions beside them.
    """
    by_section: dict[str, list[Record]] = {}
    for record in records:
        by_section.setdefault(canonical(section_key(record)), []).append(record)
    whole_records = whole(records)
    sections = tuple(
        _page_section(
            protocol,
            section,
            by_section[canonical(section_key(section.record))],
            whole_records,
            errors,
        )
        for section in sections_of(whole_records)
    )
    name, ranking = protocol.spec.id, board_spec(protocol.spec.id).ranking
    intro = "" if ranking is None else f"Rows are ordered by {ranking.name}, trivial ones last."
    if not sections:
        intro = f"No run has been added yet: `tactibench board add RUN` adds one of {name}."
    papers = (published_table(paper, protocol.spec.id) for paper in published)
    timed = [r for section in sections for row in section.rows for r in row.records if r.speed]
    return BoardPage(
        f"{name}: {protocol.spec.title}",
        intro,
        sections,
        tuple(paper for paper in papers if paper is not None),
        {machine(record): machine_words(record) for record in sorted(timed, key=machine)},
    )


def _page_section(
    protocol: LoadedProtocol,
    section: Section,
    records: Iterable[Record],
    whole_records: Sequence[Record],
    errors: Errors,
) -> PageSection:
    """Return a section of a board.

    Args:
        protocol: The protocol.
        section: Rows of the section.
        records: Records of the section.
        whole_records: Records of all sections that learned from all presses.
        errors: Errors press by press, by the name of the record.
    """
    name, first = protocol.spec.id, section.record
    spec, rows = board_spec(name), ordered(name, section.rows)
    error, ranked = spec.ranking, ranks(name, rows, errors)
    tables: list[Table | None] = []
    for k, block in enumerate(metric_blocks(spec, rows)):
        if block.apart:
            apart = ordered(name, rows, block.apart)
            order = ranks(name, apart, errors, block.apart)
            apart_table = metric_table(block, apart, order)
            # A row has one place to link to.
            tables.append(apart_table and replace(apart_table, anchors=()))
        else:
            tables.append(metric_table(block, rows, None if k else ranked))
    if first.test_sensor is not None and error is not None:
        own_test = [row_on_own_test(row, whole_records) for row in rows]
        tables.append(own_test_table(rows, own_test, error))
    if protocol.spec.axes:
        tables += hard_case_tables(rows, protocol.spec.axes)
    learning = () if error is None else tuple(curves(rows_of(records), error))
    if error is not None:
        tables.append(curve_table(learning, error))
    timed = any(record.speed for row in rows for record in row.records)
    if timed and (first.test_sensor is None or trained_on(first)):
        tables.append(cost_table(rows))  # elsewhere the same weights cost the same
    notes = tuple(filter(None, _notes(name, rows)))
    said: set[str] = set()
    shown = tuple(_say_once(table, said) for table in tables if table is not None)
    return PageSection(section, tuple(rows), learning, notes, shown, _commits(rows))


def _say_once(table: Table, said: set[str]) -> Table:
    """Return a table without the notes of the tables before it."""
    new = tuple(note for note in table.notes if note not in said)
    said.update(new)
    return replace(table, notes=new)


def _notes(name: str, rows: Sequence[Row]) -> Iterator[str]:
    """Yield how a section was tested, how exact its simulator is, and which rows it lacks."""
    first = rows[0].first
    yield _tested(first, shots=any(row.first.shots for row in rows))
    lines = (error_line(record) for row in rows for record in row.records)
    line = next(filter(None, lines), "")  # all were tested on the same scenes
    yield f"{line[0].upper()}{line[1:]}." if line else ""
    yield f"{BELOW}: {BELOW_BOUND}." if any(row.below_bound for row in rows) else ""
    absent = sorted(TRIVIAL - {row.first.model.name for row in rows})
    if absent and not trained_on(first):  # the board does not know where recordings lie
        options = "".join({command_options(row.first) for row in rows})
        text = f"`tactibench run {name} --model {absent[0]}{options}`"
        text += "".join(f", and with `--model {model}`" for model in absent[1:])
        yield f"Trivial rows are missing: {text} on this sensor."


def _tested(record: Record, *, shots: bool) -> str:
    """Return on how many frames and presses a section was tested; "" for the protocol's own.

    Args:
        record: First record of the section.
        shots: Whether some rows were shown labelled presses of the tested sensor.
    """
    tested, frames = record.test_sensor, record.data.test
    if tested is None:
        return ""
    counted = f"{tested.presses:,} presses"
    if frames != tested.presses:
        counted = f"{frames:,} frames of {counted}"
    if trained_on(record):  # what it was trained on stands in the title
        fitted = fitted_frames(record)
        if fitted is None:
            return ""
        fits = f"offset and pivot of the labels to {fitted.labels:,}"
        if fitted.simulator:
            fits = f"the simulated sensor to {fitted.simulator:,}, which test nothing; {fits}"
        return f"`labelled frames besides` counts those to which something else was fitted: {fits}."
    instances = training_instances(record)
    learned_from = f"{instances} sensors of the make" if instances else "the sensor itself"
    options = command_options(record)[1:]
    on = f": `{options}`" if options else f" of {tested.description}"
    text = f"Trained on {learned_from} and tested on {counted}{on}."
    if shots:
        text += " Rows with labelled presses saw so many of it before (`--test shots=N`)."
    return text


def _commits(rows: Iterable[Row]) -> str:
    """Return the commits that the runs were made with, and whether files had been changed."""
    counts = Counter(record.identity.commit for row in rows for record in row.records)
    parts = []
    for commit, count in sorted(counts.items()):
        name, plus, _ = commit.partition("+")
        changed = ", with uncommitted changes" if plus else ""
        parts.append(f"`{name[:10]}`{changed} ({count})")
    return f"Runs by commit of tactibench: {'; '.join(parts)}."


def machine_words(record: Record) -> str:
    """Return the machine of a record in words, such as "AMD EPYC; 2 logical cores; avx2"."""
    facts = record.environment
    parts = [
        facts.cpu,
        f"{facts.cores_logical} logical cores" if facts.cores_logical else None,
        ", ".join(facts.cpu_flags),
        *facts.gpu,
        f"torch {facts.torch}" if facts.torch else None,
        facts.os,
    ]
    return "; ".join(part for part in parts if part)


def board_rows(
    board: Path, protocols: Iterable[LoadedProtocol] | None = None
) -> list[dict[str, Any]]:
    """Return one line for every board, row and metric: rank, mean over seeds, interval, counts.

    Costs have their own lines, one for every machine that a row was timed on.

    Args:
        board: Folder of the board.
        protocols: The protocols; None: all that ship.
    """
    if protocols is None:
        protocols = [load_protocol(name) for name in protocol_files()]
    lines: list[dict[str, Any]] = []
    for protocol in protocols:
        records = read_submissions(board, protocol.spec.id)
        errors = all_press_errors(board, records)
        for section in sections_of(whole(records)):
            ranked = ranks(protocol.spec.id, section.rows, errors)
            for k, row in enumerate(section.rows):
                rank = None if ranked is None else ranked.by_row[k]
                subject = {
                    "protocol": protocol.spec.id,
                    "sensor": section.title,
                    "model": row.model,
                    "encoder": row.encoder or None,
                    "regime": row.regime,
                    "prior": prior_of(row.first),
                    "mixing": row.mixing or None,
                    "seeds": list(row.seeds),
                }
                lines += [{**subject, **facts, "rank": rank} for facts in _facts(row)]
    return lines


def _facts(row: Row) -> Iterator[dict[str, Any]]:
    for metric, group in dict.fromkeys((m.metric, m.group) for r in row.records for m in r.metrics):
        pooled = row.metric(metric, group)
        if pooled is not None:
            yield {
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
    for part in by_machine(row):
        for metric, (unit, quantity) in COSTS.items():
            if values := part.over(quantity):
                yield {
                    "seeds": list(part.seeds),
                    "metric": metric,
                    "group": machine(part.first),
                    "value": sum(values) / len(values),
                    "unit": unit,
                }
