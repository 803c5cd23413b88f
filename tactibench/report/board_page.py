"""The page of a board: a function of the committed records and published tables.

The Markdown pages under ``leaderboards/`` and the chapters of the HTML report are the same blocks,
written by two writers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from tactibench.board import (
    BELOW_BOUND,
    Curve,
    Errors,
    Row,
    Section,
    all_press_errors,
    check_folder,
    committed_protocols,
    curves,
    ordered,
    ranks,
    read_submissions,
    row_on_own_test,
    section_key,
    sections_of,
    trained_on,
    whole,
)
from tactibench.board.grouping import rows_of
from tactibench.errors import UserError
from tactibench.protocols import (
    BoardSpec,
    LoadedProtocol,
    PublishedTable,
    load_protocol,
    protocol_files,
    published_for,
)
from tactibench.protocols.board_spec import board_spec
from tactibench.protocols.loader import VARIABLE
from tactibench.records import Record, atomic, canonical
from tactibench.report.board_tables import (
    BELOW,
    cost_blocks,
    curve_table,
    machine_list,
    metric_blocks,
    metric_table,
    own_test_table,
)
from tactibench.report.document import (
    Block,
    Bullets,
    Fold,
    Group,
    Heading,
    fold_tables,
    prose,
    say_once,
)
from tactibench.report.hard_cases import hard_case_blocks
from tactibench.report.numbers import plural
from tactibench.report.published_tables import published_blocks
from tactibench.report.section_notes import (
    count_scenes,
    describe_test,
    list_commits,
    missing_trivial,
    simulator_error,
)
from tactibench.report.writers.markdown import markdown
from tactibench.shipped import shipped_folder

READING = prose("""\
Each table holds one sensor: simulated and real never share a column. A row is a model with its
parameters (those that are not at their defaults), encoder and training regime, its training seeds
pooled. Values are means over seeds; below them, the mean of the seeds' 95 % intervals over
presses. `sd`: standard deviation over training seeds, which is not part of the interval. `prior
knowledge`: what a model knew of contacts that press together besides the frames of its regime, and
how many frames it mixed for itself out of single presses, per training frame. Models in italics
are trivial. `n/a`: not measured, or one seed has no value. Rank: rows share one where their order
may be chance, that of other presses and of other training seeds. The first row of a rank has a
smaller error than each row of a later rank at p < 0.05, adjusted for the number of comparisons
(Holm). Two other rows of different ranks need not differ. A row that cannot be told apart from the
first one of a rank shares it, even where a row with a smaller error can. Its seeds scatter, as a
rule (`sd`); the note below a table names such rows. The presses of a table are those of the first
one where nothing else is said.""")
"""How to read the tables of every board."""
READING_COSTS = prose("""\
Latency: one frame to contacts in mm, batch 1, one thread where nothing else is said. frames/s: the
best batch. To float32: median distance of the timed configuration's answers from the float32 ones,
which are scored. Times may be compared inside one machine only. \\*: not settled, because they
still drifted after the warm-up, or because others computed meanwhile. Operations: floating-point,
of one frame. Memory: peak of the whole process while it was timed. Training: a run that found its
weights in the cache shows the time that they took.""")
"""How to read latency and cost."""
GENERATED = "<!-- Made by `tactibench board` from submissions/ and published/; do not edit. -->"


@dataclass(frozen=True)
class PageSection:
    """The tables of one sensor.

    Attributes:
        section: Rows, sensor and test frames.
        rows: Rows of the first table, in their order.
        curves: Learning curves.
        blocks: All tables and notes.
    """

    section: Section
    rows: tuple[Row, ...]
    curves: tuple[Curve, ...]
    blocks: tuple[Block, ...]

    @property
    def title(self) -> str:
        """The sensor, and the test frames where they are not its own."""
        return self.section.title


@dataclass(frozen=True)
class BoardPage:
    """A board as blocks.

    Attributes:
        title: Title of the protocol.
        intro: Notes on the tables of this board alone; ``READING`` holds for those of all boards.
        sections: Tables of each sensor.
        published: Published tables with their heading; empty where no paper has a row.
        timed_on: The machines behind the fingerprints; empty where nothing was timed.
    """

    title: str
    intro: tuple[Block, ...]
    sections: tuple[PageSection, ...]
    published: tuple[Block, ...]
    timed_on: tuple[Block, ...] = ()

    def markdown(self) -> str:
        """Return the page as it stands under ``leaderboards/``.

        It is about two screens long: the first table of the first sensor is shown, all others are
        folded behind their titles.
        """
        costs = [READING_COSTS] if self.timed_on else []
        blocks: list[Block] = [Group("How to read the tables", (READING, *costs)), *self.intro]
        for k, part in enumerate(self.sections):
            if k == 0:
                blocks += [Heading(2, part.title), *fold_tables(part.blocks, 1)]
            else:
                blocks.append(Group(part.title, part.blocks))
        blocks += (
            Group("Notes on the printed figures", (block,)) if isinstance(block, Bullets) else block
            for block in self.published
        )
        body = markdown([*blocks, *self.timed_on])
        return f"# {self.title}\n\n{GENERATED}\n\n{body}\n"


@dataclass(frozen=True)
class PageFile:
    """The file of a page, and the records that it was made from.

    Attributes:
        path: File under ``leaderboards/``.
        text: Text that it shall hold.
        protocol: The protocol.
        submissions: Its records.
    """

    path: Path
    text: str
    protocol: LoadedProtocol
    submissions: tuple[Record, ...] = field(repr=False)

    @property
    def records(self) -> int:
        """Number of records."""
        return len(self.submissions)

    @property
    def on_curve(self) -> int:
        """Number of records of fewer presses, which belong to learning curves."""
        return self.records - len(whole(self.submissions))

    @property
    def current(self) -> bool:
        """True if the file holds exactly this text."""
        try:
            return self.path.read_text(encoding="utf-8") == self.text
        except (OSError, UnicodeDecodeError):
            return False

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
    files = protocol_files()
    for name in committed_protocols(board):
        if name not in files:
            raise UserError(
                f"{board} holds records of protocol {name!r}, which is not installed; name the "
                f"folder of its .toml file in {VARIABLE}."
            )
    # The board of a laboratory shows its own protocols, not all that ship.
    shown = {*committed_protocols(board), *(name for name in files if _page(board, name).is_file())}
    pages = [_page_file(board, load_protocol(name)) for name in files if name in shown]
    return [page for page in pages if page.submissions or page.path.is_file()]


def _page(board: Path, name: str) -> Path:
    return board / f"{name}.md"


def published_tables(protocol: LoadedProtocol, board: Path) -> list[PublishedTable]:
    """Return the published tables of a protocol: the board's own, or those of the package."""
    folder_of_board = board / "published"
    folder = folder_of_board if folder_of_board.is_dir() else shipped_folder("published")
    return published_for(protocol.spec, folder)


def _page_file(board: Path, protocol: LoadedProtocol) -> PageFile:
    name = protocol.spec.id
    records = read_submissions(board, name)
    tables, errors = published_tables(protocol, board), all_press_errors(board, records)
    page = board_page(protocol, records, tables, errors)
    return PageFile(_page(board, name), page.markdown(), protocol, tuple(records))


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
    name = protocol.spec.id
    spec = board_spec(name)
    on_section: dict[str, list[Record]] = {}
    for record in records:
        on_section.setdefault(canonical(section_key(record)), []).append(record)
    whole_records = whole(records)
    sections = tuple(
        _page_section(
            spec,
            section,
            protocol,
            on_section[canonical(section_key(section.record))],
            whole_records,
            errors,
        )
        for section in sections_of(whole_records)
    )
    intro = _order(spec)
    if not sections:
        text = f"No run has been added yet: `tactibench board add RUN` adds one of {name}."
        intro.append(prose(text))
    title = f"{name}: {protocol.spec.title}"
    guides_shown: set[str] = set()
    sections = tuple(
        replace(part, blocks=say_once(part.blocks, guides_shown, set())) for part in sections
    )
    timed_on = machine_list(row for part in sections for row in part.rows)
    papers = tuple(published_blocks(name, published))
    return BoardPage(title, tuple(intro), sections, papers, tuple(timed_on))


def _order(spec: BoardSpec) -> list[Block]:
    if spec.ranking is None:
        return []
    return [prose(f"Rows are ordered by {spec.ranking.name}, trivial ones last.")]


def _page_section(
    spec: BoardSpec,
    section: Section,
    protocol: LoadedProtocol,
    records: Iterable[Record],
    whole_records: Sequence[Record],
    errors: Errors,
) -> PageSection:
    """Return a section of a board.

    Args:
        spec: Tables of the board.
        section: Rows of the section.
        protocol: The protocol.
        records: Records of the section.
        whole_records: Records of all sections that learned from all presses.
        errors: Errors press by press, by the name of the record.
    """
    name, first = protocol.spec.id, section.record
    rows = ordered(name, section.rows)
    blocks: list[Block | None] = [
        *describe_test(first, any(row.first.shots for row in rows)),
        *count_scenes(first),
        *simulator_error(rows),
        *([prose(f"{BELOW}: {BELOW_BOUND}.")] if any(row.below_bound for row in rows) else []),
    ]
    ranked = ranks(name, rows, errors)
    for k, table in enumerate(metric_blocks(spec, rows)):
        if table.apart:
            ordered_rows = ordered(name, rows, table.apart)
            blocks.append(
                metric_table(table, ordered_rows, ranks(name, ordered_rows, errors, table.apart))
            )
        else:
            blocks.append(metric_table(table, rows, None if k else ranked))
    if first.test_sensor is not None and spec.ranking is not None:
        own_test = [row_on_own_test(row, whole_records) for row in rows]
        blocks.append(own_test_table(rows, own_test, spec.ranking))
    blocks += hard_case_blocks(rows, protocol.spec.axes)
    learning: tuple[Curve, ...] = ()
    if spec.ranking is not None:
        learning = tuple(curves(rows_of(records), spec.ranking))
        blocks.append(curve_table(learning, spec.ranking))
    timed = any(record.speed for row in rows for record in row.records)
    if timed and (first.test_sensor is None or trained_on(first)):
        blocks += cost_blocks(rows)  # elsewhere the same weights cost the same
    runs = [record for row in rows for record in row.records]
    signatures = tuple(record.signature for record in runs)
    summary = f"Signature{'s' if len(runs) > 1 else ''} of {plural(len(runs), 'run')}"
    blocks += missing_trivial(name, rows)
    blocks.append(Group("Commits and signatures", (list_commits(runs), Fold(summary, signatures))))
    present = tuple(block for block in blocks if block is not None)
    return PageSection(section, tuple(rows), learning, present)
