"""The command `tactibench sim validate`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    short_help="error and cost of every tier against finite elements",
    help="Show error and cost of every tier and term on the finite-element scenes that ship: tips "
    "of R = 1 to 8 mm, alone and in pairs and triples, by depth, spacing, radius and shear.",
)
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PNG",
    help="Draw speed against error.",
)
@click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write every number.",
)
@click.option(
    "--frames",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write the scenes as frames of --sensor, with their true contacts. Compare only if --out "
    "or --json is given, too.",
)
@click.option(
    "--sensor", "name", default="tactip-127", show_default=True, help="Preset for --frames."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the frames' noise."
)
def validate(
    out: Path | None, json_file: Path | None, folder: Path | None, name: str, seed: int
) -> None:
    """Compare every tier with the finite-element scenes, or write these as frames."""
    from tactibench import UserError
    from tactibench_sim.reference_frames.scenes import (
        shipped_file,
        shipped_other_tips,
        shipped_sideways,
    )

    if out is not None and out.suffix.lower() != ".png":
        raise UserError(
            f"the picture is a PNG file, --out names {out.name}; call it {out.stem}.png."
        )
    for option, path in (("--out", out), ("--json", json_file), ("--frames", folder)):
        if path is not None and not path.resolve().parent.is_dir():
            raise UserError(f"the folder {path.parent} of {option} is not there; make it first.")
    if folder is not None:
        _frames(folder, name, seed)
        if out is None and json_file is None:
            return
    from rich.console import Console

    from tactibench.lab import write_json
    from tactibench_sim.commands.tier_errors import TIERS, judge, rows, worst_cases
    from tactibench_sim.commands.tier_report import draw, print_report
    from tactibench_sim.mechanics.dome import TableMechanics
    from tactibench_sim.mechanics.tables import shipped
    from tactibench_sim.mechanics.tips import TipMechanics

    reference, others, sideways = shipped_file(), shipped_other_tips(), shipped_sideways()
    counts = [sum(len(s.tips) == k for s in reference.scenes) for k in (2, 3, 1)]
    subject = "finite-element scenes: {} pairs, {} triples, {} isolated tips".format(*counts)
    tables, scenes = shipped(), (*reference.scenes, *others.scenes, *sideways.scenes)
    tiers = [judge(tier, TipMechanics(TableMechanics(tables, tier)), scenes) for tier in TIERS]
    console = Console(highlight=False)
    digests = ", ".join(one.digest[:12] for one in (reference, others, sideways))
    more = f"{len(others.scenes)} of tips of other radii, {len(sideways.scenes)} of dragged skin"
    console.print(f"{subject} of R = 3 mm, {more}; sha256 {digests}", soft_wrap=True)
    print_report(console, tiers)
    if out is not None:
        draw(out, tiers, f"speed against error of the simulator's tiers\n{subject}")
        console.print(f"picture: {out}", soft_wrap=True)
    if json_file is not None:
        record = {
            "reference": {"sha256": reference.digest, **reference.parameters},
            "other_tips": {"sha256": others.digest, **others.parameters},
            "sideways": {"sha256": sideways.digest, **sideways.parameters},
            "tables_sha256": tables.digest,
            "metrics": rows(tiers),
            "worst": worst_cases(tiers),
        }
        write_json(json_file, record)


def _frames(folder: Path, name: str, seed: int) -> None:
    import numpy as np

    from tactibench import SensorContext, UserError
    from tactibench_sim.hooks import tactibench_sensors
    from tactibench_sim.reference_frames.frames import write
    from tactibench_sim.reference_frames.scenes import shipped
    from tactibench_sim.sensor import SimulatedTacTip

    specs = {spec.name: spec for spec in tactibench_sensors()}
    if name not in specs:
        raise UserError(f"unknown simulated sensor {name!r}; known: {', '.join(specs)}.")
    sensor = specs[name].load()(SensorContext(np.random.SeedSequence(seed)))
    if not isinstance(sensor, SimulatedTacTip):
        raise UserError(
            "finite elements have the pins of tactip-127 and tactip-331; take one of them as "
            f"--sensor, not {name!r}."
        )
    count = write(folder, sensor, shipped(), seed)
    click.echo(f"{count} frames: {folder}")
