"""A setup whose camera is a real stream: an MJPEG server, and an arm for driver cri.

The arm lives in the process under test, and tells the server how deep it is.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

FPS = 30.0
SIDE = 64
PORT = "MJPEG_RIG_PORT"
"""Variable of the environment: the port at which the server hears of the arm."""
ROOT = Path(__file__).parents[2]


class Arm:
    """An arm as those of cri are: ``move_linear`` returns when it stands there.

    Its base frame is the work frame. It starts 40 mm above the sensor.
    """

    def __init__(self) -> None:
        self.pose = (0.0, 0.0, -40.0, 0.0, 0.0, 0.0)
        self.linear_speed = 20.0
        self._server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._server.connect(("127.0.0.1", int(os.environ[PORT])))

    def move_linear(self, pose: tuple[float, ...]) -> None:
        """Take as long as the way takes at the speed, at most half a second."""
        start, distance = self.pose, float(np.linalg.norm(np.subtract(pose[:3], self.pose[:3])))
        steps = 1 + int(100.0 * min(0.5, distance / self.linear_speed))
        for step in range(1, steps + 1):
            time.sleep(0.01)
            share = step / steps
            self.pose = tuple(a + share * (float(b) - a) for a, b in zip(start, pose, strict=True))  # type: ignore[assignment]
            self._server.send(str(self.pose[2]).encode())

    def close(self) -> None:
        """Close the line to the server."""
        self._server.close()


class MjpegCamera:
    """A camera of 30 frames/s over HTTP (multipart JPEG), which ``cv2.VideoCapture`` opens.

    Attributes:
        cut: Set to end all streams and refuse new ones.
        side: Of its frames, px.
        fps: Frames a second.
        lag_s: Time by which a frame comes late.
        frozen: Whether it sends the same frame again and again.
    """

    def __init__(self) -> None:
        self.cut, self.frozen = threading.Event(), threading.Event()
        self.side, self.fps, self.lag_s = SIDE, FPS, 0.0
        self._heights = [(0.0, -40.0)]
        rows, columns = np.indices((SIDE, SIDE))
        self._rest = 30.0 + 120.0 * ((rows % 8 < 3) & (columns % 8 < 3))
        self._pattern = np.roll(self._rest, 1, axis=0) - self._rest
        self._arm = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._arm.bind(("127.0.0.1", 0))
        os.environ[PORT] = str(self._arm.getsockname()[1])
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        threading.Thread(target=self._hear, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.cut.set()
        self._server.shutdown()
        self._server.server_close()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
            last.sendto(b"", self._arm.getsockname())

    def _hear(self) -> None:
        with self._arm:
            while data := self._arm.recv(64):
                self._heights = [*self._heights[-400:], (time.monotonic(), float(data))]

    @property
    def url(self) -> str:
        """Address of the stream."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/camera.mjpg"

    def _jpeg(self, rng: np.random.Generator) -> bytes:
        noise = rng.normal(0.0, 1.5, self._rest.shape)
        then = time.monotonic() - self.lag_s
        height = next((z for t, z in self._heights[::-1] if t <= then), -40.0)
        image = self._rest + self._pattern * min(0.5, 0.1 * max(0.0, height))
        noisy = np.clip(image + noise, 0, 255).astype(np.uint8)
        noisy = cv2.resize(noisy, (self.side, self.side))
        return cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        camera = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if camera.cut.is_set():
                    self.send_error(503)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                rng, data, due = np.random.default_rng(0), b"", time.monotonic()
                try:
                    while not camera.cut.wait(max(0.0, due - time.monotonic())):
                        # A server that was starved goes on: a camera does not make up for it.
                        due = max(due + 1.0 / camera.fps, time.monotonic())
                        data = data if data and camera.frozen.is_set() else camera._jpeg(rng)
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                        self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
                except OSError:  # the reader went away
                    return

            def log_message(self, *_: Any) -> None:
                """Nobody reads them."""

        return Handler


def write_configuration(folder: Path, source: str) -> Path:
    """Write and return a configuration of an ``Arm`` under the camera at an address."""
    path = folder / "lab.toml"
    path.write_text(
        f"""schema = 1
[robot]
driver = "cri"
address = "mjpeg_rig:Arm"
[frames]
work_frame = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
[camera]
source = "{source}"
warmup_frames = 10
[contact]
method = "fixed"
""",
        encoding="utf-8",
    )
    return path


def run_hw(
    *arguments: str,
    meanwhile: Callable[[subprocess.Popen[str]], object] = lambda _: None,
) -> tuple[int, str, str]:
    """Run ``tactibench hw`` in a process of its own; return its exit code, stdout and stderr."""
    paths = [str(ROOT), str(ROOT / "plugins"), str(ROOT / "tests" / "shared")]
    with subprocess.Popen(
        [sys.executable, "-m", "tactibench", "hw", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        process_group=0,
        # A background job, as the tests may be, ignores Ctrl-C and hands that down.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            meanwhile(process)
            out, error = process.communicate(timeout=120)
        finally:
            process.kill()
    return process.returncode, out, error


def interrupt(process: subprocess.Popen[str], *after_s: float) -> None:
    """Press Ctrl-C after so many seconds, again and again."""
    for seconds in after_s:
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
