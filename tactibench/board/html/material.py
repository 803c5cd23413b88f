"""What a report is made from: stored runs, committed records, or both, protocol by protocol."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tactibench.board.boards import check_folder
from tactibench.board.committed import PressErrors, answers_file, press_errors_of
from tactibench.board.html.answers import Answered, Truth, answered, unpacked_truth
from tactibench.board.html.origins import AUTO, BOARD, RUNS
from tactibench.board.published import PublishedTable, load_published
from tactibench.board.ranking import RANKING
from tactibench.board.ranks import Errors
from tactibench.board.submissions import FOLDER, all_press_errors, read_submissions, slot
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import LoadedProtocol, protocol_files, read_protocol
from tactibench.records.record import Record
from tactibench.records.store import RECORD, StoredRun, stored_runs
from tactibench.run.request import folder_label
from tactibench.shipped import shipped_folder


@dataclass(frozen=True, eq=False)
class Board:
    """One protocol. runs: stored ones, by the name of their record. answers: of those that were
    opened. committed: where the answers of the other records lie."""

    protocol: LoadedProtocol
    records: tuple[Record, ...]
    published: tuple[PublishedTable, ...]
    errors: Errors
    runs: Mapping[str, StoredRun] = field(default_factory=dict)
    answers: Mapping[str, Answered] = field(default_factory=dict)
    committed: Path | None = None

    @property
    def name(self) -> str:
        return self.protocol.keys.id

    def answers_of(self, record: Record) -> Path | None:
        """The file of a committed record's answers, where it is one and there are any."""
        if self.committed is None or record.name in self.runs:
            return None
        path = answers_file(self.committed / f"{record.name}.json")
        return path if path.is_file() else None


@dataclass(frozen=True)
class Material:
    """origin: one sentence on what was read, and what was left out."""

    boards: tuple[Board, ...]
    origin: str


def gather(
    store: Path, board: Path, *, origin: str = AUTO, protocols: Sequence[str] = ()
) -> Material:
    """Read what a report is made from. origin: one of ORIGINS; auto takes the store's runs where it
    holds complete ones, else the committed records. protocols: those shown; () for all that have
    records.

    Raises UserError for an unknown protocol, or where there is nothing to show.
    """
    files = protocol_files()
    for name in protocols:
        if name not in files:
            raise UserError(f"unknown protocol {name!r}; {did_you_mean(name, files)}")
    runs = list(stored_runs(store)) if origin != BOARD else []
    whole = [run for run in runs if not run.record.partial]
    if origin == AUTO:
        origin = RUNS if whole else BOARD
    if origin == RUNS and not whole:
        raise UserError(_nothing_stored(store, len(runs)))
    if origin != RUNS:
        check_folder(board)
    shown = [name for name in files if not protocols or name in protocols]
    boards = [
        _board(name, files[name], whole, board if origin != RUNS else None, board) for name in shown
    ]
    boards = [one for one in boards if one.records or one.name in protocols]
    if not boards:
        raise UserError(
            f"there is no complete run to show, neither in {store} nor in {board}; run a protocol "
            "first, or name another store with --runs."
        )
    return Material(tuple(boards), _said(origin, store, runs, boards))


def _board(
    name: str, path: Path, runs: Iterable[StoredRun], committed: Path | None, published: Path
) -> Board:
    protocol = read_protocol(path)
    records = read_submissions(committed, name) if committed is not None else []
    taken: dict[str, StoredRun] = {}
    for run in sorted(runs, key=lambda run: (run.record.created, run.record.name)):
        if run.record.protocol.id == name:
            taken[slot(run.record)] = run  # of one row and seed the newest
    kept = [record for record in records if slot(record) not in taken]
    errors = dict(all_press_errors(committed, kept)) if committed is not None else {}
    opened = _opened(protocol, taken.values())
    if name in RANKING:
        errors |= _ranked(opened)
    own = published / "published"
    tables = load_published(
        protocol.keys.published.tables, own if own.is_dir() else shipped_folder("published")
    )
    return Board(
        protocol,
        tuple(sorted([*kept, *(run.record for run in taken.values())], key=lambda r: r.name)),
        tuple(tables),
        errors,
        {run.record.name: run for run in taken.values()},
        opened,
        None if committed is None else committed / FOLDER / name,
    )


def _opened(protocol: LoadedProtocol, runs: Iterable[StoredRun]) -> dict[str, Answered]:
    """Answers and truth of the runs whose arrays are whole, by name; equal arrays are read once."""
    truths: dict[str, Truth] = {}
    known: dict[tuple[str, str], Answered] = {}
    found = {}
    for run in runs:
        record = run.record
        if record.protocol.hash != protocol.hash:
            continue
        stored = record.identity.stored
        truth, answers = (str(stored.get(part)) for part in ("truth", "predictions"))
        try:
            if truth not in truths:
                truths[truth] = unpacked_truth(protocol.keys, run.arrays("truth"))
            if (truth, answers) not in known:
                predicted = run.arrays("predictions")
                known[truth, answers] = answered(protocol.keys, truths[truth], predicted)
        except (UserError, KeyError, IndexError, ValueError):
            continue  # the figures that need them say which runs they lack
        found[record.name] = known[truth, answers]
    return found


def _ranked(opened: Mapping[str, Answered]) -> dict[str, PressErrors]:
    """What the board ranks by, press by press, once for equal answers."""
    known = {id(one): press_errors_of(one.keys, one.trials) for one in set(opened.values())}
    return {name: known[id(one)] for name, one in opened.items()}


def _said(origin: str, store: Path, runs: Sequence[StoredRun], boards: Sequence[Board]) -> str:
    """What is shown, where it is from, and how much of the store is not shown."""
    stored = sum(len(board.runs) for board in boards)
    committed = sum(len(board.records) for board in boards) - stored
    shown = []
    if origin != RUNS:
        shown.append(_counted(committed, "committed record"))
    if origin != BOARD:
        shown.append(f"{_counted(stored, 'run')} stored in {folder_label(store)}")
    newest = max((r.created[:10] for b in boards for r in b.records), default="")
    partial = sum(run.record.partial for run in runs)
    other = len(runs) - partial - stored
    damaged = 0 if origin == BOARD else len(list(store.glob(f"[!.]*/{RECORD}"))) - len(runs)
    left = [_counted(partial, "partial run")] if partial else []
    left += [_counted(damaged, "run") + " that cannot be read"] if damaged else []
    left += (
        [f"{_counted(other, 'run')} of other protocols, or older ones of the same row and seed"]
        if other
        else []
    )
    text = f"Made from {' and '.join(shown)}" + (f", the newest of {newest}" if newest else "")
    return f"{text}. Left out: {' and '.join(left)}." if left else f"{text}."


def _counted(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def _nothing_stored(store: Path, partial: int) -> str:
    found = (
        f"{partial} partial runs (--quick or --limit) and no complete one"
        if partial
        else ("no complete run")
    )
    return (
        f"{store} holds {found}; run a protocol whole, name another store with --runs, or "
        "leave --from out to see the committed boards."
    )
