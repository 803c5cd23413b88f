"""The report: boards and stored runs as one HTML file, or as a site of several.

The same data gives the same bytes. A Content-Security-Policy names the one script by its hash, so
that no other script can run, whatever text a name or note holds.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from matplotlib.figure import Figure

from tactibench import __version__
from tactibench.board import (
    Errors,
    PressErrors,
    Row,
    all_press_errors,
    check_folder,
    frontiers,
    machine,
    overview,
    press_errors_of,
    read_submissions,
    slot,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.metrics import Trials, gospa_with_depth
from tactibench.protocols import (
    LoadedProtocol,
    PublishedTable,
    board_spec,
    load_protocol,
    overview_spec,
    protocol_files,
    published_for,
)
from tactibench.records import Record, StoredRun, stored_runs
from tactibench.report.board_pages import (
    BoardPage,
    PageSection,
    board_page,
    machine_words,
    published_folder,
)
from tactibench.report.board_tables import overview_table
from tactibench.report.curve_plots import by_distance, distance_figure, stability_figure
from tactibench.report.frame_plots import contacts_figure
from tactibench.report.pages import asset, render
from tactibench.report.real_page import real_page
from tactibench.report.run_pictures import RunArrays
from tactibench.report.style import CURVES, image_bytes
from tactibench.report.tables import Table, plural
from tactibench.report.tradeoff_plots import (
    curve_figure,
    frontier_figure,
    frontier_table,
    unseen_frontiers,
)
from tactibench.run import folder_label
from tactibench.shipped import default_board

POLICY = (
    "default-src 'none'; script-src '{}'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'"
)
INDEX = "index.html"
WORST_ROWS, WORST = 8, 3
"""Most rows whose worst frames are shown, the best first, and number of frames of each."""
PAGE_DPI = 100
Advance = Callable[[int], None]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class ReportBoard:
    """One protocol in a report.

    Attributes:
        protocol: The protocol.
        records: Records of all runs that are shown.
        published: Tables of papers.
        errors: Errors press by press, by the name of the record.
        runs: Stored runs, by the name of the record.
    """

    protocol: LoadedProtocol
    records: tuple[Record, ...]
    published: tuple[PublishedTable, ...]
    errors: Errors
    runs: Mapping[str, StoredRun] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The id of the protocol."""
        return self.protocol.spec.id

    @property
    def page(self) -> BoardPage:
        """Tables and notes, as on the page of the board."""
        return board_page(self.protocol, self.records, self.published, self.errors)


@dataclass(frozen=True)
class ReportData:
    """The data of a report.

    Attributes:
        boards: Boards in the order of the page.
        origin: A sentence on what was read and what was left out.
    """

    boards: tuple[ReportBoard, ...]
    origin: str


def gather(store: Path | None, board: Path | None, *, protocols: Sequence[str] = ()) -> ReportData:
    """Return the data of a report, read from a store, a board, or both.

    Args:
        store: The run store; None: no stored runs.
        board: Folder of the leaderboards; None: no committed records.
        protocols: Protocols that are shown; () for all that have records.

    Raises:
        UserError: A protocol is unknown, the arrays of a run are damaged, or there is nothing to
            show.
    """
    names = protocol_files()
    for name in protocols:
        if name not in names:
            raise UserError(f"unknown protocol {name!r}; {did_you_mean(name, names)}")
    runs = [] if store is None else list(stored_runs(store))
    complete = [run for run in runs if not run.record.partial]
    if board is not None:
        check_folder(board)
    read = [
        _board(load_protocol(name), complete, board)
        for name in names
        if not protocols or name in protocols
    ]
    boards = [one for one in read if one.records or one.name in protocols]
    if not any(one.records for one in boards):
        asked = f" of {' and '.join(protocols)}" if protocols else ""
        places = " or ".join(folder_label(place) for place in (board, store) if place is not None)
        raise UserError(
            f"there is no complete run{asked} to show in {places}; run a protocol whole, or name "
            "another folder with --store or --board."
        )
    stored = sum(len(one.runs) for one in boards)
    committed = sum(len(one.records) for one in boards) - stored
    shown = [] if board is None else [plural(committed, "committed record")]
    if store is not None:
        shown.append(f"{plural(stored, 'run')} stored in {folder_label(store)}")
    newest = max((r.created[:10] for one in boards for r in one.records), default="none")
    text = f"Made from {' and '.join(shown)}, the newest of {newest}."
    if left_out := len(runs) - stored:
        text += f" Left out: {plural(left_out, 'partial, other or older run')}."
    return ReportData(tuple(boards), text)


def _board(protocol: LoadedProtocol, runs: Iterable[StoredRun], board: Path | None) -> ReportBoard:
    """Return a board: of one row and seed the newest stored run, else the committed record."""
    newest: dict[str, StoredRun] = {}
    for run in sorted(runs, key=lambda run: (run.record.created, run.record.name)):
        if run.record.protocol.hash == protocol.hash:
            newest[slot(run.record)] = run
    by_name = {run.record.name: run for run in newest.values()}
    committed: list[Record] = []
    errors: dict[str, PressErrors] = {}
    if board is not None:
        records = read_submissions(board, protocol.spec.id)
        committed = [record for record in records if slot(record) not in newest]
        errors = all_press_errors(board, committed)
    if board_spec(protocol.spec.id).ranking is not None:
        for name, run in by_name.items():
            arrays = run.arrays("truth"), run.arrays("predictions")
            errors[name] = press_errors_of(protocol.spec, *arrays)
    shown = sorted((*committed, *(run.record for run in by_name.values())), key=lambda r: r.name)
    tables = tuple(published_for(protocol.spec, published_folder(board or default_board())))
    return ReportBoard(protocol, tuple(shown), tables, errors, by_name)


@dataclass(frozen=True)
class Option:
    """One choice of a panel.

    Attributes:
        label: Name of the choice.
        image: The picture, as a data URI.
        tables: Numbers behind the picture, where no table of the page has them.
        note: Words below the picture.
    """

    label: str
    image: str
    tables: tuple[Table, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Chapter:
    """One protocol in a template.

    Attributes:
        key: Name of its anchor.
        page: Its tables and notes.
        figures: Figures of every section: name of a panel in the template -> its choices.
        lacking: Name of the protocol where no worst frames can be shown; "" elsewhere.
    """

    key: str
    page: BoardPage
    figures: tuple[Mapping[str, Sequence[Option]], ...]
    lacking: str


def report_page(data: ReportData, *, advance: Advance = lambda _: None) -> str:
    """Return the HTML of a report, all in one file.

    Args:
        data: Data of the report.
        advance: Called with 1 when the tables of a board are made, and when its figures are.
    """
    chapters = [_chapter(board, advance) for board in data.boards]
    links = [("#glance", "At a glance"), *((f"#{c.key}", c.key) for c in chapters)]
    return _rendered(data, chapters, links, address=lambda _, anchor: f"#{anchor}")


def site_pages(data: ReportData, *, advance: Advance = lambda _: None) -> Iterator[tuple[str, str]]:
    """Yield the name and the HTML of every page of a site: the index, then one page a protocol.

    A row has the address ``PROTOCOL.html#ANCHOR``, which stays when others are added.

    Args:
        data: Data of the site.
        advance: Called with 1 when the tables of a board are made, and when its figures are.
    """
    others = [(f"{board.name}.html", board.name) for board in data.boards]
    links = [(INDEX, "All boards"), *others]
    address = "{}.html#{}".format
    yield INDEX, _rendered(data, [], links, here=INDEX, address=address)
    for board in data.boards:
        here = f"{board.name}.html"
        yield here, _rendered(data, [_chapter(board, advance)], links, here=here)


def _chapter(board: ReportBoard, advance: Advance) -> Chapter:
    page = board.page
    advance(1)
    rows = [row for part in page.sections for row in part.rows]
    lacking = board.protocol.spec.answer == "contacts" and not any(
        row.first.name in board.runs for row in rows
    )
    figures = tuple(_figures(part, board) for part in page.sections)
    advance(1)
    key = re.sub(r"[^a-z0-9-]", "-", board.name)
    return Chapter(key, page, figures, board.name if lacking else "")


def _rendered(
    data: ReportData,
    chapters: Sequence[Chapter],
    links: Sequence[tuple[str, str]],
    *,
    here: str = "",
    address: Callable[[str, str], str] | None = None,
) -> str:
    """Return a page.

    Args:
        data: Data of the report.
        chapters: Boards that are shown.
        links: Address and name of the chapters, or of the other pages of a site.
        here: The page's own address in a site.
        address: Makes the link to a row from its protocol and its anchor, for the table over all
            boards; None: a page without this table.
    """
    script = asset("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    overall, real = None, None
    if address is not None:
        records = {board.name: board.records for board in data.boards}
        lines, real = overview(records), real_page(records)
        lead = overview_spec().protocol
        overall = overview_table(lines, link=lambda anchor: address(lead, anchor))
    return render(
        "report.html.j2",
        origin=data.origin,
        version=__version__,
        links=links,
        here=here,
        chapters=chapters,
        style=asset("page.css"),
        script=script,
        policy=POLICY.format(f"sha256-{digest}"),
        overall=overall,
        real=real,
        glance=address is not None,
    )


def _figures(part: PageSection, board: ReportBoard) -> dict[str, tuple[Option, ...]]:
    """Return the figures of one sensor, by the name of their panel."""
    rows = [row for row in part.rows if not row.trivial]
    error, axes, where = board_spec(board.name).ranking, board.protocol.spec.axes, part.title
    pairs = [row for row in rows if len(by_distance(row, "resolved")) > 1]
    distance = partial(distance_figure, published=board.published, measured_on=where)
    cases = partial(stability_figure, axes=axes, measured_on=where)
    found = {
        "frontier": _frontiers(part, board),
        "distance": _best(pairs, distance),
        "cases": _best(rows if axes else (), cases, "png"),
        "worst": tuple(_worst_frames(rows[:WORST_ROWS], board)),
    }
    if error is not None:
        found["curve"] = _best(part.curves, partial(curve_figure, error=error, measured_on=where))
    return found


def _image(figure: Figure, kind: Literal["png", "svg"] = "svg") -> str:
    data = base64.b64encode(image_bytes(figure, kind, PAGE_DPI)).decode()
    return f"data:image/{'png' if kind == 'png' else 'svg+xml'};base64,{data}"


def _best(
    rows: Sequence[T], draw: Callable[[Sequence[T]], Figure], kind: Literal["png", "svg"] = "svg"
) -> tuple[Option, ...]:
    """Return a picture of the best rows, as many as can be told apart; () without rows."""
    if not rows:
        return ()
    note = f"The best {CURVES} of {len(rows):,} rows." if len(rows) > CURVES else ""
    return (Option("", _image(draw(rows[:CURVES]), kind), note=note),)


def _frontiers(part: PageSection, board: ReportBoard) -> tuple[Option, ...]:
    """Return a picture for every machine that timed rows."""
    error = board_spec(board.name).ranking
    rows, options = [row for row in part.rows if not row.trivial], []
    if error is None:
        return ()
    for name in sorted({machine(record) for row in rows for record in row.records}):
        regimes = [regime for regime in frontiers(rows, error, name) if regime.points]
        if regimes:
            words = f"{machine_words(regimes[0].points[0].row.first)} ({name})"
            untimed = ", ".join(label for regime in regimes for label in regime.untimed)
            note = f"Without a time or an error: {untimed}." if untimed else ""
            unseen = unseen_frontiers(board.name, part.section, regimes)
            figure = frontier_figure(regimes, error, unseen=unseen)
            tables = tuple(frontier_table(regime, error) for regime in regimes)
            options.append(Option(words, _image(figure), tables, note))
    return tuple(options)


def _worst_frames(rows: Sequence[Row], board: ReportBoard) -> Iterator[Option]:
    """Yield the worst of the frames that were stored with the first seed of every row."""
    spec = board.protocol.spec
    for row in rows if spec.answer == "contacts" else ():
        run = board.runs.get(row.first.name)
        if run is None:
            continue
        arrays = RunArrays(run, spec)
        if "images" not in arrays.examples:  # a reader could not interpret a picture of channels
            continue
        frames = [int(k) for k in arrays.examples["index"]]
        trials = Trials(
            tuple(arrays.contacts[k] for k in frames),
            tuple(arrays.predicted[k] for k in frames),
            arrays.truth["press"][frames],
            tuple(str(arrays.truth["group"][k]) for k in frames),
            max_depth=spec.workspace.depth_max_mm,
            gate=spec.test.gate_mm,
            level=spec.test.level,
        )
        errors = gospa_with_depth(trials).values
        examples = [
            (f"{trials.press[k]}: {errors[k]:.3f} mm", arrays.example(frames[k]))
            for k in np.argsort(-errors, kind="stable")[:WORST]
        ]
        note = (
            f"Seed {row.seeds[0]}, of the {len(frames)} frames that the run stored; "
            f"{len(arrays.contacts):,} were tested."
        )
        yield Option(row.label, _image(contacts_figure(examples), "png"), note=note)
