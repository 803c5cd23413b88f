"""``tactibench hw live``."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from tactibench.lab import trained_model
from tactibench_tactip.camera import Camera, Image
from tactibench_tactip.commands.output import (
    device_options,
    json_option,
    number_option,
    open_devices,
    picture_option,
    print_rows,
    write_figures,
)
from tactibench_tactip.frame_check import Reference

if TYPE_CHECKING:
    from tactibench.live import WatchPage
    from tactibench_tactip.live import LiveReading, PressLoop

REST_FRAMES = 20


@click.command("live")
@click.argument("model")
@device_options
@click.option("--protocol", default="exp1", show_default=True, help="Whose weights.")
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="KIND.NAME=VALUE",
    help="As the weights were trained with.",
)
@click.option(
    "--data",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="DIR",
    help="Weights that were trained on this data set.",
)
@click.option("--regime", help="Frames the weights were trained on; default: the protocol's first.")
@click.option(
    "--untrained", is_flag=True, help="Random weights of a network, to see the latency alone."
)
@number_option("--frames", click.IntRange(min=1), 300, "Frames to answer.")
@click.option("--press", is_flag=True, help="Let the robot press meanwhile, as exp1 does.")
@click.option("--serve", is_flag=True, help="Show the picture on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0: any free.")
@picture_option("Write the last picture with a contact.")
@json_option
def command(
    model: str,
    protocol: str,
    params: tuple[str, ...],
    data: Path | None,
    regime: str | None,
    untrained: bool,
    frames: int,
    press: bool,
    serve: bool,
    port: int,
    out: Path | None,
    json_file: Path | None,
    **device: Any,
) -> None:
    """Answer frames as they come and show camera, pins, heatmap, contacts and the loop's latency.

    Latency is from a frame's arrival to the list of contacts (scenario `loop`). Without --serve
    and --out a line in the terminal shows the contacts. The sensor must be untouched at the start.
    """
    # OpenCV draws the view; the other commands start without it.
    from tactibench.live import WatchPage
    from tactibench_tactip.live import HALF_MM, PressLoop, watch

    sensor = None if data is None else "recorded"
    network, label = trained_model(
        model, protocol, params=params, data=data, regime=regime, sensor=sensor, untrained=untrained
    )
    with open_devices(**device) as (settings, _), ExitStack() as stack:
        presses: PressLoop | None = None
        if press:
            presses = stack.enter_context(PressLoop(settings))
            camera = presses.station.camera
            rest = presses.station.rest_reference().image
            presses.begin()
        else:
            camera = stack.enter_context(Camera(settings.camera))
            rest = Reference.of(camera.fresh(time.monotonic_ns(), REST_FRAMES)).image
        page = stack.enter_context(WatchPage(label, HALF_MM, port)) if serve else None
        display = _Display(rest, label, page)

        def show(reading: LiveReading) -> bool:
            display.show(reading)
            return presses is None or not presses.failed

        raw_ms, dropped = watch(camera, network, rest, frames, show)
    display.end(out)
    _print_latency(raw_ms, dropped, label, untrained, json_file)


class _Display:
    """The place where turns of the loop are shown: a page, a file, a line of the terminal."""

    def __init__(self, rest: Image, label: str, page: WatchPage | None) -> None:
        from tactibench.live import PinLines

        self._pins = PinLines(rest)
        self._label, self._page = label, page
        self._last: LiveReading | None = None
        if page is not None:
            click.echo(f"live view: {page.url}", err=True)

    def show(self, reading: LiveReading) -> None:
        if self._last is None or reading.has_contact:
            self._last = reading
        if self._page is not None:
            self._page.show(reading.view(self._pins))
        elif sys.stderr.isatty():
            from tactibench.live import describe_prediction

            line = f"{reading.latency_ms:6.1f} ms  {describe_prediction(reading.prediction)}"
            click.echo(f"\r{line[:100]:<100}", nl=False, err=True)

    def end(self, out: Path | None) -> None:
        if sys.stderr.isatty():
            click.echo(err=True)
        if out is not None and self._last is not None:
            import cv2

            from tactibench_tactip.live import Painter

            picture = Painter(self._pins).draw(self._last, self._label)
            out.write_bytes(cv2.imencode(".png", picture)[1].tobytes())  # imwrite hides errors
            click.echo(f"picture: {out}")


def _print_latency(
    raw_ms: list[float], dropped: float, label: str, untrained: bool, json_file: Path | None
) -> None:
    p50, p90, p99 = (float(value) for value in np.percentile(raw_ms, (50, 90, 99)))
    values = {"p50": p50, "p90": p90, "p99": p99, "mean": float(np.mean(raw_ms))}
    row = (label, *(f"{value:.1f}" for value in values.values()))
    print_rows(
        ("loop, ms", *values, "frames", "dropped"),
        [(*row, f"{len(raw_ms):,}", f"{dropped:.0%}")],
    )
    if untrained:
        click.echo("RANDOM WEIGHTS: the answers say nothing")
    write_figures(json_file, [("loop", name, value, "ms") for name, value in values.items()])
