"""``tactibench hw live``: a model that watches the camera, its latency, and presses meanwhile."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Frame, Model, PlatePose, Pose
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
            camera, rest = station.camera, station.rest_reference().image
            presses = stack.enter_context(press_meanwhile(station))
        else:
            camera = stack.enter_context(make_robot(settings).camera(settings.camera))
            rest = Reference.of(camera.fresh(time.monotonic_ns(), REST_FRAMES)).image
        page = stack.enter_context(WatchPage(label, HALF_MM, port)) if serve else None
        if page is not None:
            click.echo(f"live view: {page.url}", err=True)
        pins, terminal = PinLines(rest), sys.stderr.isatty()

        def show(reading: LiveReading) -> bool:
            if page is not None:
                image = reading.frame.image
                answer = AnswerView(reading.prediction, reading.latency_ms, reading.maps)
                page.show(FrameView(image, pins(image), [answer]))
            elif terminal:
                line = f"{reading.latency_ms:6.1f} ms  {describe_prediction(reading.prediction)}"
                click.echo(f"\r{line[:100]:<100}", nl=False, err=True)
            return presses is None or not presses.done() or presses.exception() is None

        raw_ms, dropped = watch(camera, network, rest, frames, show)
    if terminal:
        click.echo(err=True)
    _print_latency(raw_ms, dropped, label)


@dataclass(frozen=True, eq=False)
class LiveReading:
    """One turn of the loop.

    Attributes:
        frame: The camera's frame.
        prediction: Prediction of the model.
        maps: (C, H, W) maps behind it, or None.
        latency_ms: Time from the frame's arrival to the prediction.
    """

    frame: CameraFrame
    prediction: Contacts | PlatePose | None
    maps: npt.NDArray[Any] | None
    latency_ms: float


def watch(
    camera: Camera, model: Model, rest: Image, turns: int, show: Callable[[LiveReading], bool]
) -> tuple[list[float], float]:
    """Let a model read the newest frame, again and again; the first turns are not counted.

    Args:
        camera: An open camera.
        model: A trained model.
        rest: (H, W) uint8 image of the undeformed sensor.
        turns: Number of turns that are counted.
        show: Called at every turn after its time was taken; False ends the loop.

    Returns:
        The latency of every turn, ms, without the wait for the frame, and the frames that came
        while the model was at work, for each frame that it read.

    Raises:
        CameraError: The camera gives no frames.
    """
    raw: list[float] = []
    start = 0
    since_ns = time.monotonic_ns()
    for turn in range(WARM_UP + turns):
        if turn == WARM_UP:
            start = camera.frames
        frame = camera.fresh(since_ns, 1)[0]
        prediction, maps = ask(model, Frame(frame.image, frame.t_ns * 1e-9, Pose(), rest))
        since_ns = time.monotonic_ns()
        latency = (since_ns - frame.t_ns) * 1e-6
        if turn >= WARM_UP:
            raw.append(latency)
        if not show(LiveReading(frame, prediction, maps, latency)):
            break
    raw = raw or [float("nan")]
    return raw, max(0, camera.frames - start - len(raw)) / len(raw)


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
    find_touch(station, first=True)
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


def _print_latency(raw_ms: list[float], dropped: float, label: str) -> None:
    p50, p90, p99 = (float(value) for value in np.percentile(raw_ms, (50, 90, 99)))
    values = {"p50": p50, "p90": p90, "p99": p99, "mean": float(np.mean(raw_ms))}
    row = (label, *(f"{value:.1f}" for value in values.values()))
    print_rows(
        ("loop, ms", *values, "frames", "dropped"),
        [(*row, f"{len(raw_ms):,}", f"{dropped:.0%}")],
    )
