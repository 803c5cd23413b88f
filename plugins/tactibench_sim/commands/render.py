"""The command `tactibench sim render`."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench_sim.commands.scene_text import HELP


@click.command(
    help=f"Draw one press: the frame, the markers' displacement, the skin.\n\nSCENE: {HELP}"
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
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of noise.")
def render(scene: str, out: Path, name: str, params: tuple[str, ...], seed: int) -> None:
    """Build the sensor and draw one press."""
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
    click.echo(f"picture: {out}")


def _given(params: tuple[str, ...]) -> dict[str, str]:
    """Read ``("sensor.tier=superpose",)`` as ``{"tier": "superpose"}``. Raises UserError."""
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
