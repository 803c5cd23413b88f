"""``tactibench sweep``: many runs on many processes."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import click

from tactibench.cli.options import json_option, save_json, store_option
from tactibench.errors import UserError

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
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.report import print_sweep
    from tactibench.run import fingerprint
    from tactibench.sweep import (
        Storage,
        list_cells,
        local_client,
        plan_cells,
        read_sweep,
        remote_client,
        result_rows,
        run_cells,
    )

    if scheduler is not None and (workers or threads):
        raise UserError(
            "--workers and --threads are for processes on this machine; leave them out with "
            "--scheduler, whose workers were started with theirs."
        )
    cells = list_cells(read_sweep(file), PluginHost())
    any_machine = scheduler is not None
    storage = Storage(store.resolve(), cache_folder().resolve(), any_machine=any_machine)
    terminal = Terminal()
    with nullcontext() if scheduler is None else remote_client(scheduler, storage) as remote:
        states = plan_cells(cells, storage, remote)
        to_do = sum(state.state == "to do" for state in states.values())
        if to_do and not dry_run:
            cores: int = fingerprint()["cores_logical"]
            count = workers or min(cores, to_do)
            share = threads or max(1, cores // count)
            local = nullcontext(remote) if remote else local_client(count, share, retries)
            with local as client:
                states = run_cells(states, client, storage, terminal)
    print_sweep(terminal.out, states, storage.store)
    if json_file is not None:
        save_json(json_file, result_rows(states, storage.store))
    return FAILED if any(state.why for state in states.values()) else 0
