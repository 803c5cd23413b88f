"""``tactibench hw plan``."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_tactip.commands.common import hours, json_option, print_rows, write_figures


@click.command("plan")
@click.argument("presses", metavar="PROTOCOL|PLAN.jsonl")
@click.option(
    "--config",
    required=True,
    metavar="FILE.toml",
    type=click.Path(path_type=Path),
    help="Configuration of the setup.",
)
@click.option("--draw", "draws", multiple=True, help="Of the protocol only these; repeat it.")
@click.option(
    "--count", type=click.IntRange(min=1), help="At most so many of every indenter of every draw."
)
@click.option("--seed", type=click.IntRange(min=0), help="Other presses than the protocol's.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.png",
    help="Draw where the tool goes.",
)
@json_option
def command(
    presses: str,
    config: Path,
    draws: tuple[str, ...],
    count: int | None,
    seed: int | None,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Check the presses that a protocol needs against the configuration, without any device.

    Every pose of every press must lie in the envelope. Shows what has to be mounted for how many
    presses and how long it takes.
    """
    from tactibench import UserError
    from tactibench_tactip.collecting.plan import check, estimate_s, fits, plan_of, words
    from tactibench_tactip.configuration import read_settings
    from tactibench_tactip.geometry.press import PressGeometry
    from tactibench_tactip.robots.connect import robot_of

    if out is not None and out.suffix.lower() != ".png":
        raise UserError(
            f"the picture is a PNG file, --out names {out.name}; call it {out.stem}.png."
        )
    settings = read_settings(config)
    plan = plan_of(presses, settings, draws=draws, count=count, seed=seed)
    geometry = PressGeometry(settings.frames, settings.sensor.dome_radius_mm)
    check(plan, settings, geometry, turns=robot_of(settings).turns)
    mounts = plan.mounts()
    seconds = [estimate_s(some, settings) for _, some in mounts]
    rows = [
        (
            words(indenter),
            f"{len(some):,}",
            hours(time),
            "mounted" if fits(settings.indenter, indenter) else "",
        )
        for (indenter, some), time in zip(mounts[:20], seconds, strict=False)
    ]
    figures: list[tuple[str, str, float, str]] = []
    for (indenter, some), time in zip(mounts, seconds, strict=True):
        figures.append(("presses", words(indenter), len(some), ""))
        figures.append(("time", words(indenter), time, "s"))
    print_rows(("indenter", "presses", "time", ""), rows)
    if len(mounts) > 20:
        click.echo(f"... and {len(mounts) - 20:,} more indenters")
    total = hours(sum(seconds))
    click.echo(f"{len(plan):,} presses of {presses}, all inside the envelope; about {total}")
    if out is not None:
        from tactibench_tactip.collecting.plan_picture import draw_plan

        draw_plan(out, plan, settings, geometry)
        click.echo(f"picture: {out}")
    write_figures(json_file, figures)
