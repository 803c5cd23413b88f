"""``tactibench board``: the leaderboards, made from committed records and nothing else."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench.cli.options import board_option, json_option, runs_option, writable_place
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.board.boards import Page
    from tactibench.records.store import StoredRun


FILE = click.Path(path_type=Path, dir_okay=False, writable=True)


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when a page is out of date.")
@click.option(
    "--add",
    "names",
    multiple=True,
    metavar="RUN",
    help="Commit a run of --runs: its name or folder, or a pattern such as 'exp1-*'.",
)
@runs_option
@board_option
@json_option
@click.option(
    "--csv",
    "csv_file",
    type=FILE,
    callback=writable_place,
    help="Write the figures here, a line a metric.",
)
@click.option(
    "--latex",
    "latex_file",
    type=FILE,
    callback=writable_place,
    help="Write the first tables here, for a paper.",
)
@click.pass_context
def board(
    ctx: click.Context,
    check: bool,
    names: tuple[str, ...],
    runs: Path,
    board_folder: Path,
    json_file: Path | None,
    csv_file: Path | None,
    latex_file: Path | None,
) -> None:
    """Write the leaderboards from the records that are committed beside them.

    --add takes complete runs from a run store into submissions/; the newer record of the same row
    and seed replaces the older one.

    \b
    tactibench board --add 'exp1-unet-*' --add exp1-mean-single-s0-1a2b3c4d
    tactibench board --check
    """
    from tactibench.board.boards import check_folder, pages
    from tactibench.board.submissions import add

    if check and names:
        raise UserError("--check writes nothing, --add does; leave one of the two out.")
    check_folder(board_folder)
    for run in _chosen(runs, names):
        added = add(run, board_folder)
        click.echo(f"added {added.path}")
        for path in added.replaced:
            click.echo(f"  in place of {path.name}, the same row and seed")
    made = pages(board_folder)
    _export(board_folder, json_file, csv_file, latex_file)
    if check:
        stale = [page for page in made if not page.current]
        for page in stale:
            click.echo(
                f"{page.path} is not what the committed records give; "
                "run `tactibench board` and commit it.",
                err=True,
            )
        if stale:
            ctx.exit(1)
        click.echo(f"{len(made)} pages are what the committed records give")
        return
    for page in made:
        click.echo(_line(page))
        if not page.current:
            page.write()


def _chosen(store: Path, names: tuple[str, ...]) -> list[StoredRun]:
    """Runs by name or pattern; a pattern passes partial runs over. Raises UserError."""
    from tactibench.records.store import open_run, run_names

    found: dict[Path, StoredRun] = {}
    for name in names:
        if not any(sign in name for sign in "*?["):
            run = open_run(store, name)
            found[run.folder] = run
            continue
        # Opened one by one: a damaged run that was passed over would change a mean.
        fitting = [open_run(store, run) for run in run_names(store) if fnmatchcase(run, name)]
        whole = [run for run in fitting if not run.record["partial"]]
        if not whole:
            partial = f", but {len(fitting)} partial ones" if fitting else ""
            raise UserError(f"{store} holds no complete run called like {name!r}{partial}.")
        found |= {run.folder: run for run in whole}
    # The oldest first, so that of one row and seed the newest stays.
    return sorted(found.values(), key=lambda run: (run.record["created"], run.folder.name))


def _line(page: Page) -> str:
    curve = f", {page.on_curve} of them for the learning curve" if page.on_curve else ""
    state = "unchanged" if page.current else "written"
    return f"{page.path}: {page.records} runs{curve}; {state}"


def _export(board: Path, json_file: Path | None, table: Path | None, latex: Path | None) -> None:
    """Tidy rows, a pooled metric of a row of a board each, and tables for a paper."""
    from tactibench.board.export import csv_text, latex_text, tidy_rows
    from tactibench.records.files import atomic, write_json

    if json_file is not None or table is not None:
        rows = tidy_rows(board)
        if json_file is not None:
            write_json(json_file, rows)
        if table is not None:
            with atomic(table) as stream:
                stream.write(csv_text(rows).encode())
    if latex is not None:
        with atomic(latex) as stream:
            stream.write(latex_text(board).encode())
