"""``tactibench submit``: a run as the two files of a pull request."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.options import board_option, out_option


@click.command()
@click.argument("run_name", metavar="RUN")
@out_option
@board_option
def submit(run_name: str, out: Path, board_folder: Path) -> None:
    """Write the record and the predictions of RUN (a name in the store, or a folder) to a board.

    Two files under submissions/PROTOCOL: NAME.json and NAME.npz. `tactibench board --add` does the
    same and makes the pages again.
    """
    from tactibench.board.boards import check_folder
    from tactibench.board.committed import answers_file
    from tactibench.board.submissions import add
    from tactibench.records.store import open_run

    check_folder(board_folder)
    added = add(open_run(out, run_name), board_folder)
    for path in (added.path, answers_file(added.path)):
        click.echo(f"wrote {path} ({path.stat().st_size / 1000:,.0f} kB)")
    for path in added.replaced:
        click.echo(f"  in place of {path.name}, the same row and seed")
    click.echo(
        f"check it with `tactibench verify {added.path}`, then open a pull request with "
        "both files; docs/submit.md says what is checked there."
    )
