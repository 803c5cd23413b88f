"""The command `tactibench sim real`."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    name="real",
    help="Fit the simulator to recorded plate presses in DIR (targets.csv and frames_bw, as in the "
    "Tac-VGNN sets) and report how far the simulated pins are from the real ones on the others.",
)
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Picture (PNG).")
@click.option(
    "--fit",
    "fit_on",
    type=click.IntRange(min=50),
    default=200,
    show_default=True,
    help="Presses to fit on.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Which presses these are.",
)
@click.option(
    "--keep",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.json",
    help="Write the fit for sensors fitted-127 and fitted-331: "
    "--param sensor.calibration=FILE.json.",
)
@click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write every number.",
)
def real(
    folder: Path,
    out: Path | None,
    fit_on: int,
    seed: int,
    keep: Path | None,
    json_file: Path | None,
) -> None:
    import json

    from tactibench import UserError
    from tactibench_sim.real.compare import compare
    from tactibench_sim.real.picture import draw

    for path in (out, keep, json_file):
        if path is not None and not path.resolve().parent.is_dir():
            raise UserError(f"the folder {path.parent} of {path.name} is not there; make it first.")
    found = compare(folder, fit_on=fit_on, seed=seed)
    record = found.record()
    error = record["median_relative_error"]
    if out is not None:
        title = (
            "pin displacements of held-out plate presses: real (black) and simulated (orange); "
            f"median relative error {error:.3f} over {len(found.presses)} presses"
        )
        draw(out, found.presses, found.labels, found.fitted.unknowns, title)
    if keep is not None:
        found.calibration.write(keep)
    if json_file is not None:
        json_file.write_text(json.dumps(found.numbers(), indent=1) + "\n", encoding="utf-8")
    click.echo(f"dome {found.fitted.kind}; all pins matched in {found.complete:.1%} of the frames")
    for name, value in record["unknowns"].items():
        click.echo(f"  {name:18s} {value:9.3f}")
    click.echo(f"\n{'held-out presses':24s} {'n':>5s} {'relative':>9s} {'px':>6s} {'of px':>6s}")
    for row in found.rows:
        measured = f"{row.relative:9.3f} {row.pixels:6.2f} {row.moved:6.2f}"
        click.echo(f"{row.group:24s} {row.presses:5d} {measured}")
    known = record["median_relative_error_state_known"]
    click.echo(
        f"\nmedian relative error {error:.3f} from the labels alone; {known:.3f} where the frame "
        f"decides whether the plate dragged the skin, which it did in {found.dragged_share:.0%}"
    )
