"""The work of ``tactibench board time``: quiet machine, models in turns, records with new times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactibench.board import Timekeeper, commit_times, refuse_noise, store_times, time_models
from tactibench.cli.output import Terminal
from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.records import StoredRun, cache_folder
from tactibench.report import print_times
from tactibench.run import data_folder, load


def time_runs(
    runs: Sequence[StoredRun], *, data: Path | None, calls: int, anyway: bool, board: Path | None
) -> list[StoredRun]:
    """Time the models of runs in turns, print the times, and return the runs with new records.

    Args:
        runs: of one protocol.
        data: folder of recorded frames.
        calls: of every model at batch 1.
        anyway: time although others compute.
        board: folder whose committed records take the times, too.

    Raises:
        UserError: the machine is not quiet, or no run can be timed.
    """
    if not anyway:
        refuse_noise(load.machine_load())
    terminal = Terminal()
    keeper = Timekeeper(PluginHost(), cache_folder(), terminal, data_folder(data))
    models = []
    with terminal.task("open models", len(runs)) as advance:
        for run in runs:
            try:
                models.append(keeper.open(run))
            except UserError as reason:
                terminal.say(f"left out: {reason}")
            advance(1)
    if not models:
        raise UserError("no run is left to be timed; the lines above say why.")
    speeds = time_models(models, terminal, calls=calls)
    timed = [store_times(model.run, speeds[model.run.record.name]) for model in models]
    earlier = [model.run.record for model in models]
    print_times(terminal.out, [run.record for run in timed], earlier)
    if board is not None:
        written = [path for run in timed if (path := commit_times(run, board)) is not None]
        terminal.say(f"wrote the times of {len(written)} committed records")
    return timed
