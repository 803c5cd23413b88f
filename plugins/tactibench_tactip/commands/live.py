"""``tactibench hw live``: a model that watches the camera, and its latency."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
import numpy as np

from tactibench import Frame, Pose
from tactibench.lab import trained_model
from tactibench.live import AnswerView, FrameView, PinLines, WatchPage, ask, describe_prediction
from tactibench_tactip.camera import Reference
from tactibench_tactip.commands.output import (
    device_options,
    number_option,
    open_devices,
    print_rows,
)
from tactibench_tactip.robots import make_robot
from tactibench_tactip.station import REST_FRAMES

WARM_UP = 20
"""First turns of the loop, which are not counted."""
HALF_MM = 12.8
"""Half the width of the heatmap's grid."""


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
@number_option("--frames", click.IntRange(min=1), 300, "Frames to answer.")
@click.option("--serve", is_flag=True, help="Show the picture on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0: any free.")
def live(
    model: str,
    protocol: str,
    params: tuple[str, ...],
    data: Path | None,
    frames: int,
    serve: bool,
    port: int,
    **device: Any,
) -> None:
    """Answer frames as they come and show camera, pins, heatmap, contacts and the loop's latency.

    Latency is from a frame's arrival to the list of contacts (scenario `loop`). Without --serve a
    line in the terminal shows the contacts. The sensor must be untouched at the start. Nothing
    presses the simulated sensor of --emulate: it stays untouched.
    """
    sensor = None if data is None else "recorded"
    network, label = trained_model(model, protocol, params=params, data=data, sensor=sensor)
    with open_devices(**device) as settings, ExitStack() as stack:
        camera = stack.enter_context(make_robot(settings).camera(settings.camera))
        rest = Reference.of(camera.fresh(time.monotonic_ns(), REST_FRAMES)).image
        page = stack.enter_context(WatchPage(label, HALF_MM, port)) if serve else None
        if page is not None:
            click.echo(f"live view: {page.url}", err=True)
        pins, terminal = PinLines(rest), sys.stderr.isatty()
        latencies_ms: list[float] = []
        before = 0
        since_ns = time.monotonic_ns()
        for turn in range(WARM_UP + frames):
            if turn == WARM_UP:
                before = camera.frames
            frame = camera.fresh(since_ns)[0]
            prediction, maps = ask(network, Frame(frame.image, frame.t_ns * 1e-9, Pose(), rest))
            since_ns = time.monotonic_ns()
            answer = AnswerView(prediction, (since_ns - frame.t_ns) * 1e-6, maps)
            if page is not None:
                page.show(FrameView(frame.image, pins(frame.image), [answer]))
            elif terminal:
                line = f"{answer.ms:6.1f} ms  {describe_prediction(answer.prediction)}"
                click.echo(f"\r{line[:100]:<100}", nl=False, err=True)
            latencies_ms.append(answer.ms)
        dropped = max(0, camera.frames - before - frames) / frames
    counted = latencies_ms[WARM_UP:]
    if terminal:
        click.echo(err=True)
    values = (*np.percentile(counted, (50, 90, 99)), np.mean(counted))
    print_rows(
        ("loop, ms", "p50", "p90", "p99", "mean", "frames", "dropped"),
        [(label, *(f"{value:.1f}" for value in values), f"{frames:,}", f"{dropped:.0%}")],
    )
