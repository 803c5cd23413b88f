"""``tactibench board``: the leaderboards and the submissions that they are made from."""

from __future__ import annotations

import shlex
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import (
    PROTOCOL,
    RUN,
    board_option,
    echo,
    json_option,
    output_file,
    own_board_option,
    runner_option,
    save_json,
    store_option,
)
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.records import StoredRun


@click.group()
def board() -> None:
    """Make the leaderboards from submissions, and check submissions.

    \b
    tactibench board show exp2               the rows of a board
    tactibench board add 'exp1-unet-*'       runs become rows
    tactibench board check                   the pages are what the records give
    tactibench board verify FILE.json        score the answers of a submission again
    tactibench board reproduce FILE.json     make its run again: train, predict, score, compare
    """


@board.command(short_help="the ranked rows of a board")
@click.argument("protocol", type=PROTOCOL)
@click.option("--full", is_flag=True, help="Print every row, sensor and table, and published ones.")
@board_option
def show(protocol: str, full: bool, board_folder: Path) -> None:
    """Print the board of PROTOCOL: the models at their defaults, as its page shows them."""
    from tactibench.board import check_folder
    from tactibench.cli.output import Terminal
    from tactibench.protocols import load_protocol
    from tactibench.report import board_words, committed_page, print_table

    check_folder(board_folder)
    loaded = load_protocol(protocol)
    name = loaded.spec.id
    page = committed_page(loaded, board_folder)
    if not page.sections:
        raise UserError(
            f"{board_folder} has no ranked rows of {name}; `tactibench board add RUN` adds one."
        )
    terminal = Terminal()
    terminal.say(f"{page.title}\n{page.result}".rstrip())
    for section in page.sections if full else page.shown:
        if full:
            terminal.say(f"\n{section.title}")
        for table in section.tables if full else section.summaries:
            terminal.say("")
            print_table(terminal.out, table)
    for table in page.published if full else ():
        terminal.say("")
        print_table(terminal.out, table)
    more = "" if full else f"tactibench board show {name} --full; "
    asked = "".join(f" {word}" for word in board_words(board_folder))
    page_file = board_folder / f"{name}.md"
    where = f"; page: {page_file}" if page_file.is_file() else ""
    terminal.say(f"\nmore: {more}tactibench report{asked}{where}")
    terminal.say_board(board_folder)


@board.command(short_help="make the pages of all boards from the records")
@own_board_option
def write(board_folder: Path) -> None:
    """Write the pages of all boards from the committed records."""
    _write_pages(board_folder)


@board.command("check", short_help="compare the pages with the records; write nothing")
@own_board_option
@click.pass_context
def check_pages(ctx: click.Context, board_folder: Path) -> None:
    """Say whether the pages are what the committed records give; exit code 1 when one is not.

    Nothing is written.
    """
    from tactibench.report import board_words, page_files

    pages = page_files(board_folder)
    stale = [page for page in pages if not page.current]
    write = ["tactibench", "board", "write", *board_words(board_folder)]
    for page in stale:
        echo(
            f"{page.path} is not what the committed records give; "
            f"run `{shlex.join(write)}` and commit it.",
            err=True,
        )
    if stale:
        ctx.exit(1)
    echo(f"{len(pages)} pages are what the committed records give")


@board.command(short_help="runs become rows, and the pages are made")
@click.argument("names", nargs=-1, required=True, metavar="RUN...", type=RUN)
@store_option
@own_board_option
def add(names: tuple[str, ...], store: Path, board_folder: Path) -> None:
    """Add each RUN (a name, a folder, or a pattern such as 'exp1-*') and write the pages.

    A newer record of the same row and seed replaces the older one. Partial runs are refused; a
    pattern passes them over.
    """
    from tactibench.board import add, check_folder
    from tactibench.records import beside, locked

    check_folder(board_folder, writes=True)
    with locked(beside(board_folder, ".lock")):  # else two do not see each other's rows
        for run in _complete_runs(store, names):
            path, replaced = add(run, board_folder)
            echo(f"added {path}")
            _echo_replaced(replaced)
        _write_pages(board_folder)


@board.command(short_help="write a run's two files for a pull request")
@click.argument("name", metavar="RUN", type=RUN)
@store_option
@own_board_option
def submit(name: str, store: Path, board_folder: Path) -> None:
    """Write the record and the predictions of RUN into a board's folder, for a pull request.

    Two files under submissions/PROTOCOL: NAME.json and NAME.npz. `board add` does the same and
    writes the pages again.
    """
    from tactibench.board import add, answers_file, check_folder
    from tactibench.records import open_run

    check_folder(board_folder, writes=True)
    record, replaced = add(open_run(store, name), board_folder)
    for path in (record, answers_file(record)):
        echo(f"wrote {path} ({path.stat().st_size / 1000:,.0f} kB)")
    _echo_replaced(replaced)
    echo(
        f"check it with `tactibench board verify {record}`, then open a pull request with "
        "both files; docs/submit.md says what is checked there."
    )


@board.command(short_help="score submissions again, without the model")
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Folder of the recorded frames that were tested.",
)
@json_option
@click.pass_context
def verify(
    ctx: click.Context,
    files: tuple[Path, ...],
    data: Path | None,
    json_file: Path | None,
) -> None:
    """Score the predictions beside committed records (submissions/PROTOCOL/NAME.json) again.

    The truth is made anew; what else a record says is its submitter's word, see `reproduce`. Exit
    code 1 when a file is refused. Hidden presses are drawn from the revealed seed, or from that in
    TACTIBENCH_HIDDEN_SEED.
    """
    from tactibench.board import Source
    from tactibench.board import verify as check
    from tactibench.cli.output import Terminal
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.report import print_verdict
    from tactibench.run import data_folder

    source = Source(PluginHost(), cache_folder(), data_folder(data))
    terminal = Terminal()
    rows: list[dict[str, Any]] = []
    refused = 0
    for path in files:
        try:
            with terminal.task(f"verify {path.stem[:60]}", 1) as advance:
                verdict = check(path, source)
                advance(1)
        except UserError as error:
            refused += 1
            reason = " ".join(str(error).split())
            terminal.say(f"REFUSED {path.name}: {reason}")
            rows.append({"file": path.name, "state": "refused", "reason": reason})
            continue
        print_verdict(terminal.out, verdict)
        verified = {"file": path.name, "state": "verified"}
        rows += [{**verified, **row.json_values()} for row in verdict.again]
    save_json(json_file, rows)
    if len(files) > 1:
        terminal.say(f"{len(files) - refused:,} of {len(files):,} verified")
    if refused:
        ctx.exit(1)


@board.command("reproduce", short_help="make the run of a record again, and compare its metrics")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Folder of the recording that the run read, or one above its recordings.",
)
@click.option(
    "--cached",
    is_flag=True,
    help="Take frames, weights and answers that are in the cache; default: all are made anew.",
)
@runner_option
@click.option("--by", metavar="NAME", help="Write into FILE that NAME reproduced it here, today.")
@json_option
@click.pass_context
def reproduce_run(
    ctx: click.Context,
    file: Path,
    data: Path | None,
    cached: bool,
    runner: str | None,
    by: str | None,
    json_file: Path | None,
) -> None:
    """Make the run of a committed record again from its request, and compare its metrics.

    The plugins that are installed press, train, predict and score anew; the model answers in a
    process that holds frames and nothing else. A model that draws nothing
    must give the same metrics to 0.001; another one must stay in the interval of each metric.
    Exit code 1 where the error that ranks the row or its misses do not.

    \b
    tactibench board reproduce leaderboards/submissions/exp1/exp1-nearest-single-s0-1a2b3c4d.json
    tactibench board reproduce FILE --data data/tac-vgnn --by "a lab"
    """
    from tactibench.board import note_reproduction, reproduce, reproduction_rows
    from tactibench.cli.output import Terminal
    from tactibench.records import cache_folder
    from tactibench.report import print_reproduction
    from tactibench.run import WorkerHost, data_folder

    terminal, command = Terminal(), runner or ""
    cache, folder = cache_folder() if cached else None, data_folder(data)
    run = reproduce(file, WorkerHost(command), terminal, data=folder, cache=cache, runner=command)
    print_reproduction(terminal.out, run)
    save_json(json_file, list(reproduction_rows(run)))
    if not run.reproduced:
        ctx.exit(1)
    if by is not None:
        note = note_reproduction(run, by)
        terminal.say(f"noted in {file}: reproduced by {note.by}, {note.date}, on {note.machine}")


@board.command(short_help="the figures of all boards as JSON or CSV")
@board_option
@json_option
@output_file("--csv", "csv_file", help="Write the figures here, a line a metric.")
def export(board_folder: Path, json_file: Path | None, csv_file: Path | None) -> None:
    """Write the figures of all boards as JSON or CSV files, a line a metric.

    In Python, `api.load_board(PROTOCOL)` returns them as a pandas frame, which writes LaTeX, too.
    """
    from tactibench.board import check_folder
    from tactibench.report import board_rows

    if json_file is csv_file is None:
        raise UserError("nothing to write; name a file with --json or --csv.")
    check_folder(board_folder)
    rows = board_rows(board_folder)
    save_json(json_file, rows)
    if csv_file is not None:
        import pandas as pd

        pd.DataFrame(rows).map(_cell).to_csv(csv_file, index=False)


def _cell(value: Any) -> Any:
    """Return a value as a spreadsheet shows it: a list as words, and no text as a formula."""
    text = " ".join(map(str, value)) if isinstance(value, list) else value
    return f"'{text}" if isinstance(text, str) and text.startswith(("=", "+", "-", "@")) else text


@board.command(short_help="publish the hash of the secret seed of test presses, or the seed")
@click.argument("protocol")
@click.option("--reveal", is_flag=True, help="Publish the seed itself, after the last run.")
@own_board_option
def hidden(protocol: str, reveal: bool, board_folder: Path) -> None:
    """Publish the hash of the secret seed in TACTIBENCH_HIDDEN_SEED for PROTOCOL.

    The hash is published before the first run: test presses that nobody has seen. The seed itself
    is revealed with the answers, so that everybody can score them again.

    \b
    export TACTIBENCH_HIDDEN_SEED=$(openssl rand -hex 32)
    tactibench board hidden exp1
    tactibench run exp1 --model unet --hidden-seed
    tactibench board hidden exp1 --reveal
    """
    from tactibench.protocols import commitment_file, commitment_text, given_seed, load_protocol
    from tactibench.records import atomic

    loaded = load_protocol(protocol)
    if loaded.spec.split is None:
        raise UserError(
            f"protocol {loaded.spec.id!r} takes recorded presses, which no seed draws; take one "
            "that draws its presses."
        )
    seed = given_seed(loaded)
    path = commitment_file(loaded, seed.commitment, board_folder / "hidden")
    if reveal and not path.exists():
        raise UserError(
            f"{path} is not there: the hash of this seed was never published, so that it proves "
            "nothing; publish the hash of a new seed, and test on that."
        )
    if path.exists() and not reveal:
        echo(f"{path} holds the hash of this seed already")
        return
    with atomic(path) as stream:
        stream.write(commitment_text(loaded, seed, reveal=reveal).encode())
    if reveal:
        echo(f"wrote {path} with the seed; commit it with the answers, and take a new seed")
    else:
        echo(f"wrote {path}: sha256 {seed.commitment}; commit it before the first run")


def _write_pages(board_folder: Path) -> None:
    from tactibench.report import page_files

    pages = page_files(board_folder)
    if not pages:
        echo(f"{board_folder} holds no run; `tactibench board add RUN` adds one")
    for page in pages:
        state = "unchanged" if page.current else "written"
        echo(f"{page.path}: {page.records} runs; {state}")
        if not page.current:
            page.write()


def _echo_replaced(paths: list[Path]) -> None:
    for path in paths:
        echo(f"  in place of {path.name}, the same row and seed")


def _complete_runs(store: Path, names: tuple[str, ...]) -> list[StoredRun]:
    """Return runs by name or pattern, the oldest first. Raises UserError."""
    from tactibench.records import open_run, run_names

    runs: dict[Path, StoredRun] = {}
    for name in names:
        if not any(sign in name for sign in "*?["):
            run = open_run(store, name)
            runs[run.folder] = run
            continue
        # Opened one by one: a damaged run that was passed over would change a mean.
        fitting = [open_run(store, run) for run in run_names(store) if fnmatchcase(run, name)]
        complete = [run for run in fitting if not run.record.partial]
        if not complete:
            partial = f", but {len(fitting)} partial ones" if fitting else ""
            raise UserError(f"{store} holds no complete run called like {name!r}{partial}.")
        runs |= {run.folder: run for run in complete}
    # The oldest first, so that of one row and seed the newest stays.
    return sorted(runs.values(), key=lambda run: (run.record.created, run.folder.name))
