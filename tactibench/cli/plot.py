"""``tactibench plot``, ``report`` and ``compare``: what many runs say together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tactibench.cli.options import (
    RUN,
    OneOf,
    add_options,
    board_option,
    json_option,
    output_file,
    param_option,
    picture_option,
    save_json,
    store_option,
)
from tactibench.errors import UserError
from tactibench.shipped import OWN_BOARD

if TYPE_CHECKING:
    from tactibench import api


@click.group()
def plot() -> None:
    """Draw what many runs say together, and print the numbers behind the picture.

    \b
    tactibench plot frontier exp2 --out frontier.png     speed against error
    tactibench plot curve exp1 --out curve.png           error against training presses
    tactibench plot stability stability --out cases.png  where errors double on hard cases
    tactibench plot limit --out map.png                  the smallest errors that noise allows
    """


board_options = add_options(
    picture_option,
    board_option,
    click.option(
        "--store",
        type=click.Path(path_type=Path, file_okay=False, exists=True),
        help="Take the complete runs of this store, too.",
    ),
    click.option("--sensor", help="Such as 'tactip-127, instance=1'; default: the nominal one."),
    json_option,
)
"""Options that say which runs are drawn, and where picture and numbers go."""


@plot.command(short_help="speed against error, and who is dominated")
@click.argument("protocol")
@board_options
@click.option("--machine", help="Fingerprint of the machine; default: that of most runs.")
def frontier(**options: Any) -> None:
    """Show which models of PROTOCOL are fast for their error, and which are dominated.

    From the committed records: the latency of one frame (p90, one thread, one machine) against the
    error that orders the board. Seeds are pooled.

    \b
    tactibench plot frontier exp2 --out docs/images/frontier-exp2.png
    """
    _plot_runs("frontier", **options)


@plot.command(short_help="error against the presses that a model learned from")
@click.argument("protocol")
@board_options
@click.option(
    "--new-sensor",
    is_flag=True,
    help="Against the labelled presses of an instance that no training saw; --sensor: its name.",
)
def curve(**options: Any) -> None:
    """Show the learning curves of PROTOCOL: the error that orders its board against presses.

    From runs with `--presses N` and the whole run of the same configuration. With --new-sensor,
    from runs that were tested on other instances of the sensor than they were trained on, after N
    labelled presses, beside runs that were trained on N presses of the instance alone.

    \b
    tactibench run exp1 --model unet --presses 250
    tactibench plot curve exp1 --store runs --out curve.png
    tactibench run exp1 --model kernel --param sensor.instances=16 \\
        --test sensor.instance=1 --test shots=50
    tactibench run exp1 --model kernel --param sensor.instance=1 --presses 50
    tactibench plot curve exp1 --new-sensor --store runs --out new.png
    """
    _plot_runs("curve", **options)


@plot.command(short_help="where errors double on hard cases")
@click.argument("protocol", default="stability")
@board_options
@click.option("--rows", multiple=True, metavar="LABEL", help="Only these rows, in this order.")
def stability(**options: Any) -> None:
    """Show where the error of every model doubles on the graded hard cases of PROTOCOL.

    From the committed records, and the complete runs of --store. Seeds are pooled. The picture
    shows the error case by case, a panel a family, of the first six rows.

    \b
    tactibench run stability --model superpose
    tactibench plot stability --out cases.png
    tactibench plot stability --rows superpose --rows vgnn --out two.png
    """
    _plot_runs("stability", **options)


def _plot_runs(
    kind: str, *, board_folder: Path, out: Path | None, json_file: Path | None, **options: Any
) -> None:
    from tactibench import api
    from tactibench.cli.output import Terminal

    terminal = Terminal()
    with terminal.task(f"read and rank for {kind}", 1) as advance:
        made = api.plot(kind, board=board_folder, **options)
        advance(1)
    _show(made, out, json_file)
    terminal.say_board(board_folder)


def _depths(_ctx: click.Context, _option: click.Parameter, text: str) -> tuple[float, ...]:
    """Read "1,3,6" as (1.0, 3.0, 6.0)."""
    try:
        return tuple(float(number) for number in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is no list of numbers such as 1,3,6.") from None


@plot.command(short_help="the Cramer-Rao bound over the workspace of a sensor")
@click.option("--sensor", default="tactip-127", show_default=True, help="Preset.")
@param_option("sensor.NAME=VALUE", "Set one.")
@click.option("--scene", type=OneOf(["single", "dual"]), default="single", show_default=True)
@click.option(
    "--depth",
    "depths",
    callback=_depths,
    metavar="MM,...",
    default="1,3,6",
    show_default=True,
    help="Depths of the press, mm.",
)
@click.option("--spacing", type=float, help="Of the two tips, mm; default 7.")
@click.option("--yaw", type=float, help="Of the two tips, deg; default 0.")
@click.option("--radius", default=3.0, show_default=True, help="Of the tips, mm.")
@click.option(
    "--range", "reach", default=6.4, show_default=True, help="Half side of the workspace, mm."
)
@click.option("--step", default=0.8, show_default=True, help="Between the presses, mm.")
@click.option(
    "--nuisance",
    "nuisances",
    default="",
    metavar="NAME,...",
    help="Unknown properties of the camera, or all.",
)
@picture_option
@json_option
def limit(
    params: tuple[str, ...],
    nuisances: str,
    out: Path | None,
    json_file: Path | None,
    **options: Any,
) -> None:
    """Show the Cramer-Rao bound on contacts over the workspace of a simulated sensor.

    No unbiased estimator has a smaller standard deviation on these frames: x, y and depth of all
    contacts are unknown together, and so is every --nuisance. The separation is that of two tips in
    the plane. For two tips a second table shows the smallest spacing at which they differ from one.

    \b
    tactibench plot limit --scene dual --spacing 6.5 --out map.png
    tactibench plot limit --scene dual --radius 1 --spacing 2 --depth 0.5,1,1.5
    tactibench plot limit --param sensor.size=256 --nuisance brightness,background,shift,roll
    """
    from tactibench import api
    from tactibench.cli.output import Terminal
    from tactibench.run import read_parameters

    names = tuple(name.strip() for name in nuisances.split(",") if name.strip())
    values = read_parameters(params, ("sensor",)).get("sensor", {})
    made = api.plot_limit(params=values, nuisances=names, progress=Terminal(), **options)
    _show(made, out, json_file)


def _show(made: api.Plot, out: Path | None, json_file: Path | None) -> None:
    """Print the numbers behind a figure, and write the figure where it is asked for."""
    from rich.text import Text

    from tactibench.cli.output import Terminal
    from tactibench.report import print_table

    terminal, shown = Terminal(), made.data
    terminal.out.print(Text(shown.subject, style="cyan"), soft_wrap=True)
    for k, table in enumerate(shown.tables):
        if k:
            terminal.say("")
        print_table(terminal.out, table)
    if shown.remarks:
        terminal.say("")
    for remark in shown.remarks:
        terminal.say(remark)
    if out is not None:
        terminal.say(f"picture: {made.save(out)}")
    save_json(json_file, shown.rows)


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
    "static files. Every row has a link of its own.",
)
@store_option
@board_option
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
    protocols: tuple[str, ...],
) -> None:
    """Write the boards, or stored runs, as one HTML file that needs no network.

    It holds tables that sort and filter, speed against error, error against distance, and the worst
    frames of stored runs. What is named is shown: the runs of --store, the records of --board, or
    both. With neither it shows the boards of a folder leaderboards; without one, the boards that
    came with tactibench and the stored runs.

    \b
    tactibench report --out report.html
    tactibench report --store runs --board leaderboards --protocol exp2
    tactibench report --site public
    """
    from tactibench.cli.output import Terminal
    from tactibench.records import atomic
    from tactibench.report import gather, report_page, site_pages

    def named(option: str) -> bool:
        return ctx.get_parameter_source(option) is not ParameterSource.DEFAULT

    if site is not None and named("out"):
        raise UserError("--out names one file and --site a folder of pages; give one of them.")
    with_board = named("board_folder") or not named("store")
    own = named("board_folder") or board_folder == OWN_BOARD
    with_runs = named("store") or (not own and store.is_dir())
    if with_runs and not store.is_dir():
        raise UserError(f"there is no run store in {store}; name one with --store DIR.")
    terminal = Terminal()
    with terminal.task("read the records", 1) as advance:
        data = gather(
            store if with_runs else None, board_folder if with_board else None, protocols=protocols
        )
        advance(1)
    with terminal.task("tables and figures", 2 * len(data.boards)) as advance:
        if site is None:
            pages = {out: report_page(data, advance=advance)}
        else:
            pages = {site / name: text for name, text in site_pages(data, advance=advance)}
    for path, text in pages.items():
        with atomic(path) as stream:
            stream.write(text.encode())
    size = sum(len(text.encode()) for text in pages.values())
    terminal.say(data.origin)
    if with_board:
        terminal.say_board(board_folder)
    count = "" if site is None else f"{len(pages)} pages, "
    terminal.say(f"wrote {next(iter(pages))} ({count}{size / 1e6:.1f} MB): open it in a browser")


@click.command()
@click.argument("names", nargs=-1, required=True, metavar="RUN RUN [RUN...]", type=RUN)
@store_option
@json_option
def compare(names: tuple[str, ...], store: Path, json_file: Path | None) -> None:
    """Compare stored runs (names in the store, or folders) that answered the same test frames.

    Paired differences of every metric that is a mean over presses, with intervals over presses,
    permutation p, and Holm's adjustment over everything that is shown.

    \b
    tactibench compare exp2-superpose-single-s0-1a2b3c4d exp2-unet-single-s0-5e6f7a8b
    """
    from tactibench import api
    from tactibench.cli.output import Terminal
    from tactibench.report import print_comparisons

    terminal = Terminal()
    compared = api.compare(*names, store=store, progress=terminal)
    print_comparisons(terminal.out, compared.runs, compared.pairs)
    save_json(json_file, compared.rows)
