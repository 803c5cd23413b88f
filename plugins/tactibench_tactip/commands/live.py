"""``tactibench hw live``: a model that watches the camera, its latency, and presses meanwhile."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import click
import numpy as np

from tactibench import Frame, Model, Pose
from tactibench.lab import trained_model
from tactibench.live import (
    AnswerView,
    FrameView,
    PinLines,
    WatchPage,
    ask,
    describe_prediction,
)
from tactibench_tactip.camera import Camera, CameraFrame, Image, Reference
from tactibench_tactip.commands.output import (
    device_options,
    number_option,
    open_devices,
    print_rows,
)
from tactibench_tactip.plan import is_mounted, plan_of, with_smallest_turn
from tactibench_tactip.robots import StopNowError, make_robot
from tactibench_tactip.station import REST_FRAMES, Station
from tactibench_tactip.touch import find_touch

WARM_UP = 20
"""First turns of the loop, which are not counted."""
HALF_MM = 12.8
"""Half the width of the heatmap's grid."""
END_S = 15.0
"""Time for a press to come to its end, before the robot is stopped."""


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
@number_option("--frames", click.IntRange(min=1), 300, "Frames to answer.")
@click.option("--press", is_flag=True, help="Let the robot press meanwhile, as exp1 does.")
@click.option("--serve", is_flag=True, help="Show the picture on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0: any free.")
def live(
    model: str,
    protocol: str,
    params: tuple[str, ...],
    data: Path | None,
    regime: str | None,
    frames: int,
    press: bool,
    serve: bool,
    port: int,
    **device: Any,
) -> None:
    """Answer frames as they come and show camera, pins, heatmap, contacts and the loop's latency.

    Latency is from a frame's arrival to the list of contacts (scenario `loop`). Without --serve a
    line in the terminal shows the contacts. The sensor must be untouched at the start.
    """
    sensor = None if data is None else "recorded"
    network, label = trained_model(
        model, protocol, params=params, data=data, regime=regime, sensor=sensor
    )
    with open_devices(**device) as settings, ExitStack() as stack:
        presses: Future[None] | None = None
        if press:
            station = stack.enter_context(Station(settings))
            presses = stack.enter_context(press_meanwhile(station))
            camera, rest = station.camera, station.rest_reference().image
        else:
            camera = stack.enter_context(make_robot(settings).camera(settings.camera))
            rest = Reference.of(camera.fresh(time.monotonic_ns(), REST_FRAMES)).image
        page = stack.enter_context(WatchPage(label, HALF_MM, port)) if serve else None
        if page is not None:
            click.echo(f"live view: {page.url}", err=True)
        pins, terminal = PinLines(rest), sys.stderr.isatty()
        latencies_ms: list[float] = []
        before = 0
        for frame, answer in islice(watch(camera, network, rest), WARM_UP + frames):
            if page is not None:
                page.show(FrameView(frame.image, pins(frame.image), [answer]))
            elif terminal:
                line = f"{answer.ms:6.1f} ms  {describe_prediction(answer.prediction)}"
                click.echo(f"\r{line[:100]:<100}", nl=False, err=True)
            if presses is not None and presses.done() and presses.exception() is not None:
                break  # the block raises it
            latencies_ms.append(answer.ms)
            before = camera.frames if len(latencies_ms) == WARM_UP else before
        counted = latencies_ms[WARM_UP:]
        dropped = max(0, camera.frames - before - len(counted)) / max(1, len(counted))
    if terminal:
        click.echo(err=True)
    values = (*np.percentile(counted, (50, 90, 99)), np.mean(counted))
    print_rows(
        ("loop, ms", "p50", "p90", "p99", "mean", "frames", "dropped"),
        [(label, *(f"{value:.1f}" for value in values), f"{len(counted):,}", f"{dropped:.0%}")],
    )


def watch(camera: Camera, model: Model, rest: Image) -> Iterator[tuple[CameraFrame, AnswerView]]:
    """Let a model read the newest frame, again and again.

    Args:
        camera: An open camera.
        model: A trained model.
        rest: (H, W) uint8 image of the undeformed sensor.

    Yields:
        The frame, and the answer to it with the latency from the frame's arrival.

    Raises:
        CameraError: The camera gives no frames.
    """
    since_ns = time.monotonic_ns()
    while True:
        frame = camera.fresh(since_ns, 1)[0]
        prediction, maps = ask(model, Frame(frame.image, frame.t_ns * 1e-9, Pose(), rest))
        since_ns = time.monotonic_ns()
        yield frame, AnswerView(prediction, (since_ns - frame.t_ns) * 1e-6, maps)


@contextmanager
def press_meanwhile(station: Station) -> Iterator[Future[None]]:
    """Press the singles of exp1 in a thread, while the block watches the camera.

    The error that ended the presses is raised at the end of the block.

    Args:
        station: An open station.

    Yields:
        The presses, which are done when all are made or one failed.

    Raises:
        UserError: First touch is not found, or a press may not be made.
    """
    plan = plan_of("exp1", station.settings, draws=("singles",), count=100)
    find_touch(station)
    station.check_plan(plan)
    ended = threading.Event()

    def press_all() -> None:
        for press in plan.presses:
            scene = with_smallest_turn(press.scene)
            if ended.is_set() or not is_mounted(station.indenter, scene.indenter):
                return
            station.press(scene)

    with ThreadPoolExecutor(1, "tactip presses") as pool:
        presses = pool.submit(press_all)
        try:
            yield presses
        finally:
            ended.set()
            if not wait([presses], END_S).done:
                station.stop_now()
    with suppress(StopNowError):
        presses.result()
