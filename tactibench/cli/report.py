"""``tactibench report`` and ``compare``: boards for people, and runs against each other."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from tactibench.cli.completion import RUN
from tactibench.cli.options import board_option, json_option, output_file, save_json, store_option
from tactibench.errors import UserError


@click.command()
@output_file(
    "--out",
    suffixes=(".html", ".htm"),
    default=Path("report.html"),
    show_default=True,
    metavar="FILE.html",
    help="Write the page here.",
)
@click.option(
    "--site",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write a site into this folder instead: an index and a page a protocol, to host as "
    "static files. Every row has a link of its own. Without --from it shows the boards, or the "
    "runs of --store where that is named.",
)
@store_option
@board_option
@click.option(
    "--from",
    "origin",
    type=click.Choice(["auto", "runs", "board", "both"]),
    default="auto",
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
    site: Path | None,
    store: Path,
    board_folder: Path,
    origin: str,
    protocols: tuple[str, ...],
) -> None:
    """Write the boards, or stored runs, as one HTML file that needs no network.

    It holds tables that sort and filter, speed against error, error against distance, and the worst
    frames of stored runs.

    \b
    tactibench report --out report.html
    tactibench report --store runs --from both --protocol exp2
    tactibench report --site public
    """
    from tactibench.cli.output import Terminal
    from tactibench.records import atomic
    from tactibench.report import AUTO, BOARD, BOTH, RUNS, gather, report_page, site_pages

    named = ctx.get_parameter_source("store") is not ParameterSource.DEFAULT
    if site is not None and ctx.get_parameter_source("out") is not ParameterSource.DEFAULT:
        raise UserError("--out names one file and --site a folder of pages; give one of them.")
    if not store.is_dir() and (origin in (RUNS, BOTH) or (named and origin == AUTO)):
        raise UserError(f"there is no run store in {store}; name one with --store DIR.")
    if site is not None and origin == AUTO:
        origin = RUNS if named else BOARD
    data = gather(store, board_folder, origin=origin, protocols=protocols)
    terminal = Terminal()
    if site is not None:
        with terminal.task("site", len(data.boards) + 1) as advance:
            pages = dict(site_pages(data, advance=lambda _: advance(1)))
        site.mkdir(parents=True, exist_ok=True)
        for name, text in pages.items():
            with atomic(site / name) as stream:
                stream.write(text.encode())
        size = sum(len(text.encode()) for text in pages.values())
        terminal.say(data.origin)
        terminal.say(f"{site / 'index.html'}: {len(pages)} pages, {size / 1e6:.1f} MB")
        return
    with terminal.task("report", len(data.boards) + 1) as advance:
        page = report_page(data, advance=lambda _: advance(1)).encode()
    with atomic(out) as stream:
        stream.write(page)
    terminal.say(data.origin)
    terminal.say(f"{out}: {len(page) / 1e6:.1f} MB")


@click.command()
@click.argument("names", nargs=-1, required=True, metavar="RUN RUN [RUN...]", type=RUN)
@click.option("--distances", is_flag=True, help="Also at every true distance of the tips.")
@store_option
@json_option
def compare(names: tuple[str, ...], distances: bool, store: Path, json_file: Path | None) -> None:
    """Compare stored runs (names in the store, or folders) that answered the same test frames.

    Paired differences of every metric that is a mean over presses, with intervals over presses,
    permutation p, and Holm's adjustment over everything that is shown.

    \b
    tactibench compare exp2-superpose-single-s0-1a2b3c4d exp2-unet-single-s0-5e6f7a8b
    """
    from tactibench import api
    from tactibench.cli.output import Terminal
    from tactibench.report import print_comparisons

    compared = api.compare(*names, distances=distances, store=store)
    print_comparisons(Terminal().out, compared.runs, compared.pairs)
    save_json(json_file, compared.rows)
