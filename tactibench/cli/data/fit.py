"""``tactibench data fit``: the geometry behind the labels of plate presses."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from tactibench.cli.options import json_option


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--depth",
    default="auto",
    metavar="COLUMN",
    help="Depth label, mm, larger is deeper (-COLUMN: smaller is deeper); default: pose_2.",
)
@click.option("--tilt", default="auto", metavar="COLUMN", help="Tilt label, deg; default: pose_6.")
@json_option
def fit(folder: Path, depth: str, tilt: str, json_file: Path | None) -> None:
    """Fit a and p of indentation = depth label + a + p (1 - cos tilt) from the pins of FOLDER.

    A robot counts depth from a pose, not from first touch, and turns the sensor about a point that
    is not the dome's centre. Pins are followed in the least sheared presses of a flat plate; their
    spread must vanish where the indentation does, at all tilts.

    \b
    tactibench data fit recordings/331
    """
    from tactibench.cli.output import Terminal
    from tactibench.cli.report.cells import print_grid
    from tactibench.datasets.importing import ImportOptions, open_recording
    from tactibench.datasets.importing.fitted import fit_recording, presses_to_fit
    from tactibench.records.files import write_json

    terminal = Terminal()
    recording = open_recording(folder)
    with terminal.task("follow pins", presses_to_fit(recording)) as advance:
        fitted = fit_recording(recording, ImportOptions(depth=depth, tilt=tilt), advance)
    found = fitted.pivot
    columns = fitted.columns
    terminal.say(
        f"indentation = {columns['depth']} + a + p (1 - cos {columns['tilt']}), from "
        f"{fitted.pins} pins in {found.presses:,} of {len(recording):,} presses"
    )
    print_grid(
        terminal.out,
        ("", "mm", "one sigma", "of scatter"),
        [
            (
                "a",
                f"{found.offset_mm:.3f}",
                f"{found.offset_std:.3f}",
                f"{found.offset_scatter:.3f}",
            ),
            ("p", f"{found.pivot_mm:.2f}", f"{found.pivot_std:.2f}", f"{found.pivot_scatter:.2f}"),
        ],
        right=frozenset({"mm", "one sigma", "of scatter"}),
    )
    terminal.say(f"median misfit of the pins' spread: {found.residual:.1%}")
    if fitted.sheared:
        terminal.say(f"shear taken out: {', '.join(fitted.sheared)}")
    terminal.say(
        f"a positive tilt moves the contact towards {fitted.lean_deg:.0f} deg of the frame "
        "(0: right, 90: down)"
    )
    params = " ".join(f"--param {name}={value}" for name, value in fitted.options().items())
    terminal.say(f"\ntactibench data import {shlex.quote(str(folder))} TARGET {params}")
    if json_file is not None:
        rows = (
            ("offset", found.offset_mm, found.offset_std, "mm"),
            ("pivot", found.pivot_mm, found.pivot_std, "mm"),
            ("lean", fitted.lean_deg, None, "deg"),
            ("misfit", found.residual, None, "share"),
            ("presses", found.presses, None, ""),
        )
        write_json(
            json_file,
            [
                {"metric": metric, "group": "all", "value": value, "std": std, "unit": unit}
                for metric, value, std, unit in rows
            ],
        )
