"""``tactibench plot frontier``: speed against error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import (
    board_option,
    json_option,
    more_runs_option,
    one_sensor_option,
    picture_option,
)
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from tactibench.board.frontier import Frontier
    from tactibench.board.ranking import RankingError


@click.command()
@click.argument("protocol")
@picture_option
@board_option
@more_runs_option
@one_sensor_option
@click.option("--machine", help="Fingerprint of the machine; default: that of most runs.")
@json_option
def frontier(
    protocol: str,
    out: Path | None,
    board_folder: Path,
    runs: Path | None,
    sensor: str | None,
    machine: str | None,
    json_file: Path | None,
) -> None:
    """Show which models of PROTOCOL are fast for their error, and which are dominated.

    From the committed records: the latency of one frame (p90, one thread, one machine) against the
    error that orders the board. Seeds are pooled.

    \b
    tactibench plot frontier exp2 --out docs/images/frontier-exp2.png
    """
    from tactibench.board.choose import gathered, left_out, of_sensor
    from tactibench.board.frontier import frontiers
    from tactibench.board.labels import whole
    from tactibench.board.ranking import ranking_error
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.frontier import print_frontiers
    from tactibench.records.files import write_json

    records = whole(gathered(protocol, board_folder, runs))
    section = of_sensor(records, sensor, protocol)
    error = ranking_error(protocol)
    found = frontiers(section.rows, error, _known(machine, section.rows))
    subject = f"{protocol}, {section.title.lower()}{_machine(found)}"
    terminal = Terminal()
    print_frontiers(terminal.out, found, error, subject)
    if hidden := left_out(records, section):
        terminal.say(f"Left out: {hidden:,} runs on other sensors.")
    if out is not None:
        from tactibench.board.figures.frontier import frontier_picture

        frontier_picture(
            out,
            found,
            error=f"{error.name}, {error.unit}",
            title="Speed against error; bars: 95 % over presses, of all seeds",
            measured_on=subject,
        )
        terminal.say(f"picture: {out}")
    if json_file is not None:
        write_json(json_file, [row for one in found for row in _json(one, error)])


def _known(machine: str | None, rows: Any) -> str | None:
    from tactibench.board.rows import machine as machine_of

    known = sorted({machine_of(record) for row in rows for record in row.records})
    if machine is not None and machine not in known:
        raise UserError(
            f"no run was timed on a machine {machine!r}; {did_you_mean(machine, known)}"
        )
    return machine


def _machine(found: Sequence[Frontier]) -> str:
    """The machine of all points, in words."""
    points = [point for one in found for point in one.points]
    if not points:
        return ""
    facts = points[0].row.first.environment
    return f", timed on {facts.cpu} ({found[0].machine})"


def _json(found: Frontier, error: RankingError) -> list[dict[str, Any]]:
    rows = []
    for point in found.points:
        verdict = {
            "dominated_by": list(found.dominated.get(point.label, ())),
            "on_frontier": point in found.best,
            "regime": found.regime,
            "machine": found.machine,
            "seeds": list(point.row.seeds),
        }
        for metric, value, unit in (
            ("p90_ms", point.latency, "ms"),
            (error.metric, point.error, error.unit),
        ):
            ends = {"value": value.value, "low": value.low, "high": value.high}
            rows.append({"metric": metric, "group": point.label, **ends, "unit": unit, **verdict})
    return rows
