"""The page of a board: a function of the committed records and published tables.

A Markdown page under ``leaderboards/`` is a sentence of result, a picture, and a short table of the
models at their defaults. The chapters of the HTML report show all rows and tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from tactibench.board import (
    BELOW_BOUND,
    Curve,
    Errors,
    Ranks,
    Row,
    Section,
    all_press_errors,
    by_machine,
    check_folder,
    command_options,
    committed_protocols,
    curves,
    fitted_words,
    frames_per_second,
    frontiers,
    latency,
    machine,
    ordered,
    overview,
    ranking_error,
    ranks,
    read_submissions,
    recording_title,
    rows_of,
    section_key,
    sections_of,
    trained_on,
    unseen_error,
    whole,
)
from tactibench.errors import UserError
from tactibench.protocols import (
    LoadedProtocol,
    PublishedTable,
    Ranking,
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
    default_places,
    doubling_table,
    metric_blocks,
    metric_table,
    overview_table,
    published_table,
    shown_errors,
    summary_table,
)
from tactibench.report.curve_plots import stability_figure
from tactibench.report.pages import MADE, render
from tactibench.report.real_page import real_page
from tactibench.report.run_view import error_line
from tactibench.report.style import CURVES, save_png
from tactibench.report.tables import Table, error_words, plural
from tactibench.report.tradeoff_plots import frontier_figure, unseen_frontiers
from tactibench.shipped import shipped_folder

LIMIT_MM = 0.05
"""An error below it says as much of the simulator: five times the simulator's median error."""
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
        summaries: The short tables of the board's page, one a regime.
        result: The sentences of the board's page, on these tables.
    """

    section: Section
    rows: tuple[Row, ...]
    curves: tuple[Curve, ...]
    notes: tuple[str, ...]
    tables: tuple[Table, ...]
    summaries: tuple[Table, ...]
    result: str

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
        name: Id of the protocol.
        title: Title of the protocol.
        intro: How the rows are ordered and what the error means, or how the first row is made.
        sections: Tables of each sensor.
        published: A table a paper; empty where no paper has a row.
        machines: Fingerprint of every machine that timed a row -> the machine in words.
    """

    name: str
    title: str
    intro: str
    sections: tuple[PageSection, ...]
    published: tuple[Table, ...]
    machines: Mapping[str, str]

    @property
    def shown(self) -> tuple[PageSection, ...]:
        """Sections of the short page: nominal simulated sensors, or all where there are none."""
        nominal = (one for one in self.sections if one.section.nominal)
        simulated = tuple(one for one in nominal if one.section.origin == "simulated")
        return simulated or self.sections

    @property
    def result(self) -> str:
        """The sentences on the tables of the first sensor; "" without rows."""
        return self.shown[0].result if self.shown else ""

    @property
    def caption(self) -> str:
        """What the page's picture shows, in words."""
        if load_protocol(self.name).spec.axes:
            return "Error of each model as a case becomes harder, a panel for each kind of case"
        return "Error against the time of an answer, of rows that were timed on one machine"

    @property
    def figure(self) -> Callable[[], Figure] | None:
        """What draws the page's picture; None where no row was timed."""
        if not self.shown or not self.result:
            return None
        section = self.shown[0]
        protocol, error = load_protocol(self.name), board_spec(self.name).ranking
        regime = next(iter(protocol.spec.regimes))
        rows = [section.rows[k] for k in default_places(section.rows)]
        rows = [row for row in rows if not row.trivial and row.regime == regime]
        words = section.summaries[0].title
        if axes := protocol.spec.axes:
            return partial(stability_figure, rows[:CURVES], axes, measured_on=words)
        if error is None or not (found := frontiers(rows, error))[0].points:
            return None
        unseen = unseen_frontiers(self.name, section.section, found)
        return partial(frontier_figure, found, error, unseen=unseen, measured_on=words)

    def markdown(self, *, pictured: bool = False) -> str:
        """Return the page as it stands under ``leaderboards/``.

        Args:
            pictured: Whether a picture stands beside the page.
        """
        elsewhere = any(s.section.origin == "real" for s in self.sections if s not in self.shown)
        return render("board.md.j2", page=self, pictured=pictured, elsewhere=elsewhere)


@dataclass(frozen=True)
class PageFile:
    """The file of a page under ``leaderboards/``, and its picture.

    Attributes:
        path: The file.
        text: Its text.
        records: Number of its records.
        figure: Draws the picture; None: the page has none.
    """

    path: Path
    text: str
    records: int
    figure: Callable[[], Figure] | None = None

    @property
    def picture(self) -> Path:
        """The file of the picture."""
        return self.path.parent / "images" / f"{self.path.stem}.png"

    @property
    def current(self) -> bool:
        """True if the file holds exactly this text, and its picture is there."""
        same = self.path.is_file() and self.path.read_bytes() == self.text.encode()
        return same and (self.figure is None or self.picture.is_file())

    def write(self) -> None:
        """Write the picture and the file, each whole or not at all."""
        if self.figure is not None:
            save_png(self.figure(), self.picture)
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
    check_folder(board, writes=True)
    names, trained, boards = protocol_files(), {}, []
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
            text = page.markdown(pictured=page.figure is not None)
            pages.append(PageFile(path, text, len(records), page.figure))
            boards.append(page)
            trained[name] = records
    real = real_page(trained)
    if real.tables:
        pages.append(PageFile(board / "real.md", real.markdown(), real.records))
    index = board / "README.md"
    if not index.is_file() or MADE in index.read_text(encoding="utf-8"):  # not a laboratory's own
        glance = overview_table(overview(trained), brief=True)
        text = render("index.md.j2", boards=boards, real=real, glance=glance)
        pages.append(PageFile(index, text, sum(page.records for page in pages)))
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
    return own if own.is_dir() else shipped_folder("leaderboards/published")


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
    sections = tuple(
        _page_section(
            protocol,
            section,
            by_section[canonical(section_key(section.record))],
            errors,
        )
        for section in sections_of(whole(records))
    )
    name, spec = protocol.spec.id, board_spec(protocol.spec.id)
    intro = spec.remark
    if spec.ranking is not None:
        intro = f"Rows are ordered by {spec.ranking.name}, trivial ones last. {intro}".rstrip()
    if not sections:
        intro = f"No run has been added yet: `tactibench board add RUN` adds one of {name}."
    papers = (published_table(paper, protocol.spec.id) for paper in published)
    timed = [r for section in sections for row in section.rows for r in row.records if r.speed]
    return BoardPage(
        name,
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
    errors: Errors,
) -> PageSection:
    """Return a section of a board.

    Args:
        protocol: The protocol.
        section: Rows of the section.
        records: Records of the section.
        errors: Errors press by press, by the name of the record.
    """
    name, first = protocol.spec.id, section.record
    spec, rows = board_spec(name), ordered(name, section.rows)
    error, ranked = spec.ranking, ranks(name, rows, errors)
    on_sensors = {test.name for test in protocol.spec.test.apart if test.instances}
    tables: list[Table | None] = []
    for k, block in enumerate(metric_blocks(spec, rows)):
        if block.apart:
            apart = ordered(name, rows, block.apart)
            order = ranks(name, apart, errors, block.apart)
            unit = "sensors" if block.apart in on_sensors else "presses"
            apart_table = metric_table(block, apart, order, unit)
            # A row has one place to link to.
            tables.append(apart_table and replace(apart_table, anchors=()))
        else:
            tables.append(metric_table(block, rows, None if k else ranked))
    if protocol.spec.axes:
        some = [row for row in rows if not row.trivial]  # what is always wrong doubles nothing
        tables.append(doubling_table(some, protocol.spec.axes) if some else None)
    learning = () if error is None else tuple(curves(rows_of(records), error))
    if error is not None:
        tables.append(curve_table(learning, error))
    timed = any(record.speed for row in rows for record in row.records)
    if timed and (first.test_sensor is None or trained_on(first)):
        tables.append(cost_table(rows))  # elsewhere the same weights cost the same
    notes = tuple(filter(None, _notes(rows)))
    said: set[str] = set()
    shown = tuple(_say_once(table, said) for table in tables if table is not None)
    summaries, result = shown[:1], ""
    if error is not None:
        groups = list(_by_regime(protocol, rows))
        summaries = tuple(_summaries(protocol, section, groups, errors))
        result = _result(protocol, groups, errors)
        result = f"{_words(section)}. {result}" if result else ""
    facts = (section, tuple(rows), learning, notes, shown)
    return PageSection(*facts, summaries, result)


def _by_regime(protocol: LoadedProtocol, rows: Sequence[Row]) -> Iterator[list[Row]]:
    """Yield the rows of every regime at their defaults, the protocol's first regime first."""
    chosen = [rows[k] for k in default_places(rows)]
    for regime in dict.fromkeys([*protocol.spec.regimes, *(row.regime for row in chosen)]):
        if group := [row for row in chosen if row.regime == regime]:
            yield group


def _words(section: Section) -> str:
    """Return the sensor or the recording of a section, as the head of its tables."""
    real = section.origin == "real" or trained_on(section.record)
    return recording_title(section.record) if real else section.title


def _regime(protocol: LoadedProtocol, rows: Sequence[Row]) -> str:
    """Return "trained in regime NAME" of rows of one regime; "" for the protocol's first one."""
    regime = rows[0].regime
    return "" if regime == next(iter(protocol.spec.regimes)) else f"trained in regime {regime}"


def _summaries(
    protocol: LoadedProtocol, section: Section, groups: Iterable[Sequence[Row]], errors: Errors
) -> Iterator[Table]:
    """Yield the short table of every regime, with the ranks inside it."""
    name, columns = protocol.spec.id, shown_errors(protocol)
    for rows in groups:
        title = ", ".join(filter(None, (_words(section), _regime(protocol, rows))))
        ranked = ranks(name, rows, errors)
        found = None if ranked is None else summary_table(rows, ranked, columns, title)
        if found is not None:
            yield found


def _result(protocol: LoadedProtocol, groups: Sequence[Sequence[Row]], errors: Errors) -> str:
    """Return the smallest errors: of every regime, and of the first one on unseen sensors.

    Returns:
        "" without models that are not trivial.
    """
    name, error, unseen = protocol.spec.id, ranking_error(protocol.spec.id), unseen_error(protocol)
    parts = []
    for rows in groups:
        models = [row for row in rows if not row.trivial]
        if best := _best(error, models, ranks(name, models, errors)):
            regime = _regime(protocol, models).capitalize()
            count = plural(len(models), "model")
            parts.append(f"{regime or f'Smallest {error.name} of {count}'}: {best}.")
        if best and not regime and unseen is not None:
            apart = next(test for test, one in board_spec(name).apart.items() if one is unseen)
            best = _best(unseen, models, ranks(name, models, errors, apart))
            parts += [f"Smallest {unseen.name}: {best}."] if best else []
    return " ".join(parts)


def _best(error: Ranking, rows: Sequence[Row], ranked: Ranks | None) -> str:
    """Return "NAME, ERROR" of the smallest error, and which rows may be as good; "" without one.

    Args:
        error: The error.
        rows: The rows.
        ranked: Their ranks by it.
    """
    values = [row.metric(error.metric, error.group) for row in rows]
    known = {k: value.value for k, value in enumerate(values) if value is not None}
    if not known or ranked is None:
        return ""
    best = min(known, key=known.__getitem__)
    head, number = error_words(error, values[best])
    unit = head.removeprefix(error.name).removeprefix(", ")
    value = "" if number is None else f"{number.text} {unit}".rstrip()
    ranks_of = zip(rows, ranked.by_row, strict=True)
    level = [row.short for row, rank in ranks_of if rank and rank.best == 1 and row != rows[best]]
    text, simulated = f"{rows[best].short}, {value}", rows[best].first.sensor.origin == "simulated"
    if simulated and unit == "mm" and known[best] < LIMIT_MM:
        text += f" (below {LIMIT_MM} mm it measures the simulator as much)"
    return f"{text}; {' and '.join(level)} may be as good" if level else text


def _say_once(table: Table, said: set[str]) -> Table:
    """Return a table without the notes of the tables before it."""
    new = tuple(note for note in table.notes if note not in said)
    said.update(new)
    return replace(table, notes=new)


def _notes(rows: Sequence[Row]) -> Iterator[str]:
    """Yield how a section was tested, how exact its simulator is, and which rows it lacks."""
    first = rows[0].first
    yield _tested(first, shots=any(row.first.shots for row in rows))
    lines = (error_line(record) for row in rows for record in row.records)
    line = next(filter(None, lines), "")  # all were tested on the same scenes
    yield f"{line[0].upper()}{line[1:]}." if line else ""
    yield f"{BELOW}: {BELOW_BOUND}." if any(row.below_bound for row in rows) else ""


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
        return fitted_words(record)
    instances = training_instances(record)
    learned_from = f"{instances} sensors of the make" if instances else "the sensor itself"
    options = command_options(record)[1:]
    on = f": `{options}`" if options else f" of {tested.description}"
    text = f"Trained on {learned_from} and tested on {counted}{on}."
    if shots:
        text += " Rows with labelled presses saw so many of it before (`--test shots=N`)."
    return text


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
                best, worst = rank or (None, None)
                place = {"best_rank": best, "worst_rank": worst}
                subject = {
                    "protocol": protocol.spec.id,
                    "sensor": section.title,
                    "model": row.model,
                    "encoder": row.encoder or None,
                    "regime": row.regime,
                    "prior": row.prior,
                    "seeds": list(row.seeds),
                }
                lines += [{**subject, **facts, **place} for facts in _facts(row)]
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
                "limits": pooled.limits,
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
