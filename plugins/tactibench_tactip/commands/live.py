"""``tactibench hw live``: a model that watches the camera, its latency, and presses meanwhile."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

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
    json_option,
    number_option,
    open_devices,
    print_rows,
    write_figures,
)
from tactibench_tactip.plan import is_mounted, plan_of, with_smallest_turn
from tactibench_tactip.robots import StopNowError, make_robot
from tactibench_tactip.settings import Settings
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
@click.option(
    "--untrained", is_flag=True, help="Random weights of a network, to see the latency alone."
)
@number_option("--frames", click.IntRange(min=1), 300, "Frames to answer.")
@click.option("--press", is_flag=True, help="Let the robot press meanwhile, as exp1 does.")
@click.option("--serve", is_flag=True, help="Show the picture on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0: any free.")
@json_option
def live(
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
    json_file: Path | None,
    **device: Any,
) -> None:
    """Answer frames as they come and show camera, pins, heatmap, contacts and the loop's latency.

    Latency is from a frame's arrival to the list of contacts (scenario `loop`). Without --serve a
    line in the terminal shows the contacts. The sensor must be untouched at the start.
    """
    sensor = None if data is None else "recorded"
    network, label = trained_model(
        model, protocol, params=params, data=data, regime=regime, sensor=sensor, untrained=untrained
    )
    with open_devices(**device) as settings, ExitStack() as stack:
        presses: PressLoop | None = None
        if press:
            presses = stack.enter_context(PressLoop(settings))
            camera, rest = presses.station.camera, presses.station.rest_reference().image
            presses.begin()
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
            return presses is None or not presses.failed

        raw_ms, dropped = watch(camera, network, rest, frames, show)
    if terminal:
        click.echo(err=True)
    _print_latency(raw_ms, dropped, label, untrained, json_file)


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


class PressLoop:
    """Presses in a thread while a person watches: the singles of exp1.

    On exit, the error that ended the presses is raised.
    """

    def __init__(self, settings: Settings) -> None:
        self.station = Station(settings)
        self._plan = plan_of("exp1", settings, draws=("singles",), count=100)
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: Exception | None = None

    def __enter__(self) -> Self:
        self.station.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join(END_S)
            if self._thread.is_alive():
                self.station.stop_now()
                self._thread.join(END_S)
        failure = self._failure
        if error is not None or failure is None:
            self.station.__exit__(kind, error, trace)
            return
        self.station.__exit__(type(failure), failure, failure.__traceback__)
        raise failure

    @property
    def failed(self) -> bool:
        """True once an error ended the presses."""
        return self._failure is not None

    def begin(self) -> None:
        """Find first touch and start the presses.

        Raises:
            UserError: First touch is not found, or a press may not be made.
        """
        station = self.station
        find_touch(station, first=True)
        station.check_plan(self._plan)
        self._thread = threading.Thread(target=self._run, name="tactip presses", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        station = self.station
        for press in self._plan.presses:
            scene = with_smallest_turn(press.scene)
            if self._end.is_set() or not is_mounted(station.settings.indenter, scene.indenter):
                return
            try:
                station.press(scene)
            except StopNowError:
                return
            except Exception as error:  # noqa: BLE001 - raised again on exit
                self._failure = error
                return


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
