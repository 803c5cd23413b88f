"""A model that watches the camera: the loop, its latency, a picture, and presses meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Frame, Model, PlatePose, Pose
from tactibench.live import AnswerView, FrameView, PinLines, ask, describe_prediction, has_contact
from tactibench_tactip.camera import Camera, CameraFrame, Image
from tactibench_tactip.errors import StopNowError
from tactibench_tactip.plan import is_mounted, plan_of, with_smallest_turn
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

WARM_UP = 20
"""First turns of the loop, which are not counted."""
SIDE = 480
HALF_MM = 12.8
"""Half the width of the heatmap's grid."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
RED, GREEN, WHITE = (60, 60, 255), (80, 220, 80), (235, 235, 235)
"""Colours as blue, green, red, which is OpenCV's order."""
HELD_S = 1.0
END_S = 15.0
"""Host seconds for a press to come to its end, before the robot is stopped."""

Picture = npt.NDArray[np.uint8]


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

    @property
    def has_contact(self) -> bool:
        """True where the model sees a contact."""
        return has_contact(self.prediction)

    def view(self, pins: PinLines) -> FrameView:
        """Return the view of this turn that a page shows."""
        image = self.frame.image
        answer = AnswerView(self.prediction, self.latency_ms, self.maps)
        return FrameView(image, pins(image), [answer])


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


class Painter:
    """Painter of a turn: the frame with its pins, the heatmap with the contacts, the figures.

    Args:
        pins: Pins of the sensor; a sensor without pins has no lines.
    """

    def __init__(self, pins: PinLines) -> None:
        self._pins = pins

    def draw(self, reading: LiveReading, label: str) -> Picture:
        """Return the picture of a turn, (SIDE + 60, 2 SIDE, 3) uint8, blue, green, red."""
        text = np.zeros((60, 2 * SIDE, 3), np.uint8)
        contacts = describe_prediction(reading.prediction)
        line = f"{label}   {reading.latency_ms:5.1f} ms from frame to answer   {contacts}"
        cv2.putText(text, line[:110], (10, 36), FONT, 0.5, WHITE, 1, cv2.LINE_AA)
        panels = np.hstack([self._draw_frame(reading.frame.image), _draw_map(reading)])
        return np.vstack([panels, text])

    def _draw_frame(self, image: Image) -> Picture:
        big = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
        panel: Any = cv2.cvtColor(big, cv2.COLOR_GRAY2BGR)
        scale = np.array([SIDE / image.shape[1], SIDE / image.shape[0]])
        for x0, y0, x, y, seen in self._pins(image):
            start, end = ((np.array([[x0, y0], [x, y]]) + 0.5) * scale).astype(int).tolist()
            colour = GREEN if seen else RED
            cv2.line(panel, start, end, colour, 1)
            cv2.circle(panel, end, 2, colour, -1)
        return np.asarray(panel, dtype=np.uint8)


def _draw_map(reading: LiveReading) -> Picture:
    panel: Any = np.zeros((SIDE, SIDE, 3), np.uint8)
    if reading.maps is not None:
        heat = np.clip(255.0 * reading.maps[0], 0, 255).astype(np.uint8)
        big = cv2.resize(heat, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
        panel = cv2.applyColorMap(big, cv2.COLORMAP_VIRIDIS)
    if isinstance(reading.prediction, Contacts):
        for x, y in reading.prediction.xy.tolist():
            at = tuple(int(SIDE / 2 * (1 + value / HALF_MM)) for value in (x, y))
            cv2.drawMarker(panel, at, WHITE, cv2.MARKER_CROSS, 22, 2)
    return np.asarray(panel, dtype=np.uint8)


class PressLoop:
    """Presses in a thread while a person watches: the singles of exp1, each held for a second.

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
                path = station.path(scene)
                with station.at(scene):
                    station.do(partial(station.down, path=path))
                    self._end.wait(HELD_S / station.settings.robot.time_scale)
                    station.draw_back()
            except StopNowError:
                return
            except Exception as error:  # noqa: BLE001 - raised again on exit
                self._failure = error
                return
