"""A model that watches the camera: loop, latency, pictures, a page, presses meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Frame, Model, PlatePose, Pose, UserError
from tactibench.markers import Tracker
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
"""OpenCV's blue, green, red."""
HOST = "127.0.0.1"
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
        return describe_prediction(self.prediction) != "no contact"


@dataclass(frozen=True)
class Latency:
    """Latency of a loop, ms, without the wait for the frame.

    dropped: Frames that came while the model was at work, for each that it read.
    """

    p50: float
    p90: float
    p99: float
    mean: float
    count: int
    dropped: float

    @classmethod
    def of(cls, raw_ms: list[float], frames: int) -> Latency:
        """Return the summary of every turn's latency; frames: that the camera gave meanwhile."""
        p50, p90, p99 = (float(value) for value in np.percentile(raw_ms, (50, 90, 99)))
        dropped = max(0, frames - len(raw_ms)) / len(raw_ms)
        return cls(p50, p90, p99, float(np.mean(raw_ms)), len(raw_ms), dropped)


def watch(
    camera: Camera, model: Model, rest: Image, turns: int, show: Callable[[LiveReading], bool]
) -> Latency:
    """Read the newest frame, again and again.

    show: called at every turn after its time was taken; False ends the loop. The first turns warm
    up and are not counted. Raises CameraError.
    """
    raw: list[float] = []
    start = 0
    since_ns = time.monotonic_ns()
    for turn in range(WARM_UP + turns):
        if turn == WARM_UP:
            start = camera.frames
        taken = camera.fresh(since_ns, 1)[0]
        prediction, maps = _predict(model, Frame(taken.image, taken.t_ns * 1e-9, Pose(), rest))
        since_ns = time.monotonic_ns()
        latency = (since_ns - taken.t_ns) * 1e-6
        if turn >= WARM_UP:
            raw.append(latency)
        if not show(LiveReading(taken, prediction, maps, latency)):
            break
    return Latency.of(raw or [float("nan")], camera.frames - start)


def _predict(model: Model, frame: Frame) -> tuple[Any, npt.NDArray[Any] | None]:
    """As a run asks: maps once where the model can show them, then what they say."""
    maps = model.maps([frame])
    if maps is None:
        return model.predict([frame])[0], None
    return model.read_maps(maps)[0], maps[0]


def describe_prediction(prediction: Contacts | PlatePose | None) -> str:
    """Return a prediction in words."""
    if isinstance(prediction, PlatePose):
        return f"plate {prediction.depth:.2f} mm deep, tilted {prediction.tilt:.1f} deg"
    if prediction is None or not len(prediction):
        return "no contact"
    contacts = zip(prediction.xy.tolist(), prediction.depth.tolist(), strict=True)
    return "; ".join(f"({x:+.2f}, {y:+.2f}) {depth:.2f} mm" for (x, y), depth in contacts)


class Painter:
    """Draws a turn: the frame with its pins, the heatmap with the contacts, the figures.

    rest: Frame of the undeformed sensor, from which pins are followed where there are any.
    """

    def __init__(self, rest: Image) -> None:
        try:
            self._tracker: Tracker | None = Tracker(rest, refine="centroid")
        except UserError:
            self._tracker = None

    def draw(self, reading: LiveReading, label: str) -> Picture:
        """Return (SIDE + 60, 2 SIDE, 3) uint8, blue, green, red."""
        text = np.zeros((60, 2 * SIDE, 3), np.uint8)
        contacts = describe_prediction(reading.prediction)
        line = f"{label}   {reading.latency_ms:5.1f} ms from frame to answer   {contacts}"
        cv2.putText(text, line[:110], (10, 36), FONT, 0.5, WHITE, 1, cv2.LINE_AA)
        panels = np.hstack([self._draw_frame(reading.frame.image), _draw_map(reading)])
        return np.vstack([panels, text])

    def _draw_frame(self, image: Image) -> Picture:
        big = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
        panel: Any = cv2.cvtColor(big, cv2.COLOR_GRAY2BGR)
        if self._tracker is not None:
            tracks = self._tracker.track(image[None])
            scale = np.array([SIDE / image.shape[1], SIDE / image.shape[0]])
            starts = ((self._tracker.rest + 0.5) * scale).astype(int)
            ends = ((tracks.xy[0] + 0.5) * scale).astype(int)
            for start, end, seen in zip(starts, ends, tracks.seen[0], strict=True):
                cv2.line(panel, start.tolist(), end.tolist(), GREEN if seen else RED, 1)
                cv2.circle(panel, end.tolist(), 2, GREEN if seen else RED, -1)
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


class Page:
    """A page on this machine, on loopback alone, that shows the latest picture (MJPEG).

    port: 0: any that is free. Raises UserError for a taken one.
    """

    def __init__(self, port: int = 0) -> None:
        self._news = threading.Condition()
        self._jpeg, self._number, self._ended = b"", 0, False
        try:
            self._server = ThreadingHTTPServer((HOST, port), self._handler())
        except OSError as error:
            raise UserError(
                f"port {port} cannot be used ({error.strerror or error}); take another with --port."
            ) from None
        self._server.daemon_threads = True

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.server_address[1]}/"

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, name="tactip page", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._ended = True
            self._news.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, picture: Picture) -> None:
        """Send a picture to everybody who looks."""
        good, data = cv2.imencode(".jpg", picture)
        if good:
            with self._news:
                self._jpeg, self._number = data.tobytes(), self._number + 1
                self._news.notify_all()

    def _next(self, after: int) -> tuple[bytes, int]:
        with self._news:
            self._news.wait_for(lambda: self._number > after or self._ended, 1.0)
            return (b"" if self._ended else self._jpeg), self._number

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                number = 0
                try:
                    while True:
                        data, number = page._next(number)
                        if not data:
                            return
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                        self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
                except OSError:  # the reader went away
                    return

            def log_message(self, *_: Any) -> None:
                """Nobody reads them."""

        return Handler


class PressLoop:
    """Presses while somebody watches: the singles of exp1, each held for a second, in a thread.

    Raises on exit what ended them.
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
        """True once something ended the presses."""
        return self._failure is not None

    def begin(self) -> None:
        """Find first touch and press from then on. Raises UserError."""
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
