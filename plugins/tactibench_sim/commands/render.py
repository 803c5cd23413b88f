"""The command `tactibench sim render`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench_sim.commands.scene_text import HELP

if TYPE_CHECKING:
    from tactibench import Scene, Sensor


@click.command(
    short_help="draw one press: frame, markers, skin, forces",
    help="Draw one press: the frame, the markers' displacement, the skin; print the force of each "
    f"contact.\n\nSCENE: {HELP}",
)
@click.argument("scene")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PNG",
    help="The picture.",
)
@click.option("--sensor", "name", default="tactip-127", show_default=True, help="Preset.")
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="sensor.NAME=VALUE",
    help="Set a parameter of the sensor, such as its tier.",
)
@click.option(
    "--modulus",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="MPA",
    help="Young's modulus of the skin, MPa: forces are printed in newtons, too.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise.")
def render(
    scene: str,
    out: Path,
    name: str,
    params: tuple[str, ...],
    modulus: float | None,
    seed: int,
) -> None:
    """Build the sensor, draw one press and print the force of each contact."""
    from tactibench import UserError
    from tactibench_sim.commands.scene_text import read_scene
    from tactibench_sim.hooks import tactibench_sensors

    press = read_scene(scene)
    if out.suffix.lower() != ".png":
        raise UserError(
            f"the picture is a PNG file, --out names {out.name}; call it {out.stem}.png."
        )
    if not out.parent.is_dir():
        raise UserError(f"the folder {out.parent} of --out is not there; make it first.")
    specs = {spec.name: spec for spec in tactibench_sensors()}
    if name not in specs:
        raise UserError(f"unknown simulated sensor {name!r}; known: {', '.join(specs)}.")
    given = _given(params)
    settings = specs[name].settings(given)
    if int(settings.get("instances", 0)) > 1:
        raise UserError(
            "a picture shows one sensor instance; name it with --param sensor.instance=N instead "
            "of sensor.instances."
        )

    import numpy as np

    from tactibench import SensorContext
    from tactibench_sim.commands.press_picture import draw
    from tactibench_sim.rendered_sensor import RenderedSensor

    sensor = specs[name].load()(SensorContext(np.random.SeedSequence(seed)), **settings)
    assert isinstance(sensor, RenderedSensor), "all simulated sensors are"  # noqa: S101
    detail = [f"simulated sensor {name}", *(f"{key} {value}" for key, value in given.items())]
    draw(out, sensor, press, scene, ", ".join(detail))
    for line in _force_lines(sensor, press, modulus):
        click.echo(line)
    click.echo(f"picture: {out}")


def _force_lines(sensor: Sensor, press: Scene, modulus: float | None) -> Iterator[str]:
    """Yield the force of each contact: in E_skin mm^2, and in N where E_skin is given, MPa."""
    from tactibench.geometry import true_contacts

    forces = sensor.forces(press)
    if forces is None:
        yield "force: not known for this sensor and tier"
        return
    contacts = true_contacts(press)
    for (x, y), depth, force in zip(contacts.xy, contacts.depth, forces, strict=True):
        newtons = "" if modulus is None else f" = {force * modulus:.4f} N"
        where = f"x {x:+.2f}, y {y:+.2f}, depth {depth:.2f} mm"
        yield f"force: {force:.4f} E_skin mm^2{newtons} ({where})"
    if not len(forces):
        yield "force: 0, nothing touches"


def _given(params: tuple[str, ...]) -> dict[str, str]:
    """Read ``("sensor.tier=superpose",)`` as ``{"tier": "superpose"}``.

    Raises:
        UserError: A text is not of the form sensor.NAME=VALUE, or a name is given twice.
    """
    from tactibench import UserError

    given: dict[str, str] = {}
    for text in params:
        name, equals, value = text.partition("=")
        key = name.removeprefix("sensor.")
        if not equals or not key or "." in key:
            raise UserError(
                f"--param {text!r} is not understood; write sensor.NAME=VALUE, for example "
                "--param sensor.tier=superpose."
            )
        if key in given:
            raise UserError(f"--param sensor.{key} is given twice; give it once.")
        given[key] = value
    return given
