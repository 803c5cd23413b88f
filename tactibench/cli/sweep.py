"""``tactibench sweep``: many runs, and large data sets, on many processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench.cli.options import json_option, store_option
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.sweep.engine import Engine
    from tactibench.sweep.planned import Place

FAILED = 1
RETRIES = 2


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--scheduler", metavar="ADDRESS", help="Of a running dask scheduler, tcp://...")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes on this machine; default: as many as it has cores.",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Of each process; default: the cores shared among them.",
)
@click.option(
    "--retries",
    type=click.IntRange(min=0),
    default=RETRIES,
    show_default=True,
    help="How often a cell whose worker died is run again.",
)
@json_option
@store_option
@click.option("--dry-run", is_flag=True, help="List the cells, done and to do, and stop.")
def sweep(
    file: Path,
    scheduler: str | None,
    workers: int | None,
    threads: int | None,
    retries: int,
    json_file: Path | None,
    store: Path,
    dry_run: bool,
) -> int:
    """Run all cells of FILE: protocol x model x regime x encoder x sensor x seed.

    What is in the store is not run again, and the same command continues an interrupted sweep.
    Ends with code 1 when a cell failed; the others have been run.

    \b
    protocol = ["exp1", "exp2"]
    model = ["mean", "cnn", "unet, width=32"]
    seed = [0, 1, 2]
    [[exclude]]
    model = "cnn"
    protocol = "exp2"
    """
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.sweep import print_sweep
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.records.files import write_json
    from tactibench.sweep.cells import cells_of
    from tactibench.sweep.local import cores, local_engine
    from tactibench.sweep.planned import Place
    from tactibench.sweep.read import read_sweep
    from tactibench.sweep.rows import rows_of
    from tactibench.sweep.sets import sets_of
    from tactibench.sweep.sweep import carry_out, look_up, looked_up

    if scheduler is not None and (workers or threads):
        raise UserError(
            "--workers and --threads are for processes on this machine; leave them out with "
            "--scheduler, whose workers were started with theirs."
        )
    asked = read_sweep(file)
    cells, sets = cells_of(asked, PluginHost()), sets_of(asked)
    place = Place(store.resolve(), cache_folder().resolve(), any_machine=scheduler is not None)
    terminal = Terminal()
    with _engine(scheduler, place) as remote:
        planned = look_up(cells, place, remote)
        finished = looked_up(planned)
        missing = [one for one in sets if not one.is_complete]
        to_do = sum(plan.state == "to do" for plan in planned.values())
        if (to_do or missing) and not dry_run:
            count = workers or (cores() if missing else min(cores(), to_do))
            share = threads or max(1, cores() // count)
            with nullcontext(remote) if remote else local_engine(count, share, retries) as engine:
                finished = carry_out(planned, sets, engine, place, retries, terminal)
    print_sweep(terminal.out, finished, sets, place.store)
    if json_file is not None:
        write_json(json_file, rows_of(finished, sets, place.store))
    return FAILED if any(one.why for one in finished) else 0


@contextmanager
def _engine(scheduler: str | None, place: Place) -> Iterator[Engine | None]:
    """The workers of a scheduler, if one is named. Raises UserError where they are of no use."""
    from tactibench.sweep.places import check_workers
    from tactibench.sweep.remote import remote_engine

    if scheduler is None:
        yield None
        return
    with remote_engine(scheduler) as engine:
        check_workers(engine, place)
        yield engine
