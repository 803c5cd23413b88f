"""The data of a report: stored runs, committed records, or both, protocol by protocol."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tactibench.board import (
    Errors,
    PressErrors,
    all_press_errors,
    check_folder,
    press_errors_of,
    read_submissions,
    slot,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import LoadedProtocol, PublishedTable, load_protocol, protocol_files
from tactibench.protocols.board_spec import board_spec
from tactibench.records import RECORD, Record, StoredRun, stored_runs
from tactibench.report.board_page import published_tables
from tactibench.report.html import AUTO, BOARD, RUNS
from tactibench.report.numbers import plural
from tactibench.run import folder_label


@dataclass(frozen=True, eq=False)
class ReportBoard:
    """A protocol in a report.

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


@dataclass(frozen=True)
class ReportData:
    """The data of a report.

    Attributes:
        boards: Boards in the order of the page.
        origin: A sentence on what was read and what was left out.
    """

    boards: tuple[ReportBoard, ...]
    origin: str


def gather(
    store: Path, board: Path, *, origin: str = AUTO, protocols: Sequence[str] = ()
) -> ReportData:
    """Return the data of a report, read from a store and a board.

    Args:
        store: The run store.
        board: Folder of the leaderboards.
        origin: One of ORIGINS; auto takes the store's runs where it holds complete ones, else the
            committed records.
        protocols: Protocols that are shown; () for all that have records.

    Raises:
        UserError: A protocol is unknown, or there is nothing to show.
    """
    files = protocol_files()
    for name in protocols:
        if name not in files:
            raise UserError(f"unknown protocol {name!r}; {did_you_mean(name, files)}")
    runs = list(stored_runs(store)) if origin != BOARD else []
    complete = [run for run in runs if not run.record.partial]
    if origin == AUTO:
        origin = RUNS if complete else BOARD
    if origin == RUNS and not complete:
        raise UserError(_no_complete_run(store, len(runs)))
    if origin != RUNS:
        check_folder(board)
    wanted = [load_protocol(name) for name in files if not protocols or name in protocols]
    read = [_board(protocol, complete, board, origin) for protocol in wanted]
    boards = [one for one in read if one.records or one.name in protocols]
    if not boards:
        raise UserError(
            f"there is no complete run to show, neither in {store} nor in {board}; run a protocol "
            "first, or name another store with --store."
        )
    return ReportData(tuple(boards), _origin_sentence(origin, store, runs, boards))


def _board(
    protocol: LoadedProtocol, runs: Iterable[StoredRun], board: Path, origin: str
) -> ReportBoard:
    name = protocol.spec.id
    newest: dict[str, StoredRun] = {}
    for run in sorted(runs, key=lambda run: (run.record.created, run.record.name)):
        if (run.record.protocol.id, run.record.protocol.hash) == (name, protocol.hash):
            newest[slot(run.record)] = run
    by_name = {run.record.name: run for run in newest.values()}
    committed: list[Record] = []
    errors: dict[str, PressErrors] = {}
    if origin != RUNS:
        committed = [r for r in read_submissions(board, name) if slot(r) not in newest]
        errors |= all_press_errors(board, committed)
    errors |= _press_errors(protocol, by_name)
    stored = [run.record for run in by_name.values()]
    shown = sorted([*committed, *stored], key=lambda record: record.name)
    tables = tuple(published_tables(protocol, board))
    return ReportBoard(protocol, tuple(shown), tables, errors, by_name)


def _press_errors(
    protocol: LoadedProtocol, runs: Mapping[str, StoredRun]
) -> dict[str, PressErrors]:
    """Return the error that orders the board, press by press; equal arrays are read once."""
    if board_spec(protocol.label).ranking is None:
        return {}
    by_hashes: dict[tuple[str, str], PressErrors] = {}
    errors = {}
    for name, run in runs.items():
        stored = run.record.identity.stored
        key = stored.get("truth", name), stored.get("predictions", name)
        if key not in by_hashes:
            try:
                truth, predicted = run.arrays("truth"), run.arrays("predictions")
                by_hashes[key] = press_errors_of(protocol.spec, truth, predicted)
            except (UserError, KeyError, ValueError):
                continue  # a damaged run is ranked by its intervals
        errors[name] = by_hashes[key]
    return errors


def _origin_sentence(
    origin: str,
    store: Path,
    runs: Sequence[StoredRun],
    boards: Sequence[ReportBoard],
) -> str:
    """Return what is shown, its origin, and how much of the store is not shown."""
    stored = sum(len(board.runs) for board in boards)
    committed = sum(len(board.records) for board in boards) - stored
    shown = []
    if origin != RUNS:
        shown.append(plural(committed, "committed record"))
    if origin != BOARD:
        shown.append(f"{plural(stored, 'run')} stored in {folder_label(store)}")
    newest = max((r.created[:10] for board in boards for r in board.records), default="")
    partial = sum(run.record.partial for run in runs)
    other = len(runs) - partial - stored
    damaged = 0 if origin == BOARD else len(list(store.glob(f"[!.]*/{RECORD}"))) - len(runs)
    left = [plural(partial, "partial run")] if partial else []
    left += [plural(damaged, "run") + " that cannot be read"] if damaged else []
    if other:
        left.append(f"{plural(other, 'run')} of other protocols, or older ones of the same row")
    text = f"Made from {' and '.join(shown)}" + (f", the newest of {newest}" if newest else "")
    return f"{text}. Left out: {' and '.join(left)}." if left else f"{text}."


def _no_complete_run(store: Path, partial: int) -> str:
    held = "no complete run"
    if partial:
        held = f"{partial} partial runs (--quick or --limit) and no complete one"
    return (
        f"{store} holds {held}; run a protocol whole, name another store with --store, or "
        "leave --from out to see the committed boards."
    )
