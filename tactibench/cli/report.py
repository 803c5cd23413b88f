"""``tactibench report``: the board as one HTML file that works offline."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from tactibench.cli.options import board_option, output_file, store_option
from tactibench.errors import UserError
from tactibench.report.html import AUTO, BOTH, ORIGINS, RUNS


@click.command()
@output_file(
    "--out",
    suffixes=(".html", ".htm"),
    default=Path("report.html"),
    show_default=True,
    metavar="FILE.html",
    help="Write the page here.",
)
@store_option
@board_option
@click.option(
    "--from",
    "origin",
    type=click.Choice(ORIGINS),
    default=AUTO,
    show_default=True,
    help="Stored runs, the committed records of the boards, or both; auto: the store's complete "
    "runs, or the boards where it has none.",
)
@click.option(
    "--protocol",
    "protocols",
    multiple=True,
    metavar="PROTOCOL",
    help="Show this one, and others named so; default: all that have runs.",
)
@click.pass_context
def report(
    ctx: click.Context,
    out: Path,
    store: Path,
    board_folder: Path,
    origin: str,
    protocols: tuple[str, ...],
) -> None:
    """Write the boards, or stored runs, as one HTML file that needs no network.

    It holds tables that sort and filter, speed against error, error against distance, the worst
    frames of stored runs, the plan and the environment.

    \b
    tactibench report --out report.html
    tactibench report --store runs --from both --protocol exp2
    """
    from tactibench.cli.output import Terminal
    from tactibench.records.files import atomic
    from tactibench.report.html.page import report_page
    from tactibench.report.html.report_data import gather

    named = ctx.get_parameter_source("store") is not ParameterSource.DEFAULT
    if not store.is_dir() and (origin in (RUNS, BOTH) or (named and origin == AUTO)):
        raise UserError(f"there is no run store in {store}; name one with --store DIR.")
    data = gather(store, board_folder, origin=origin, protocols=protocols)
    terminal = Terminal()
    with terminal.task("report", len(data.boards) + 1) as advance:
        page = report_page(data, advance=lambda _: advance(1)).encode()
    with atomic(out) as stream:
        stream.write(page)
    terminal.say(data.origin)
    terminal.say(f"{out}: {len(page) / 1e6:.1f} MB")
