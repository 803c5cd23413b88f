"""A setup whose camera is a real stream: an MJPEG server, and an arm for driver cri.

The arm lives in the process under test. The server shows pins at rest, whatever the arm does, so
presses must be too shallow to be seen.
"""

from __future__ import annotations

import os
import signal
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
ROOT = Path(__file__).parents[2]


class Arm:
    """An arm as those of cri are: ``move_linear`` returns when it stands there.

    Its base frame is the work frame. It starts 40 mm above the sensor.
    """

    def __init__(self) -> None:
        self.pose = (0.0, 0.0, -40.0, 0.0, 0.0, 0.0)
        self.linear_speed = 20.0

    def move_linear(self, pose: tuple[float, ...]) -> None:
        """Take as long as the way takes at the speed, at most half a second."""
        distance = float(np.linalg.norm(np.subtract(pose[:3], self.pose[:3])))
        time.sleep(min(0.5, distance / self.linear_speed))
        self.pose = tuple(float(value) for value in pose)  # type: ignore[assignment]

    def close(self) -> None:
        """Do nothing."""


class MjpegCamera:
    """A camera of 30 frames/s over HTTP (multipart JPEG), which ``cv2.VideoCapture`` opens.

    Attributes:
        cut: Set to end all streams and refuse new ones.
    """

    def __init__(self) -> None:
        self.cut = threading.Event()
        rows, columns = np.indices((SIDE, SIDE))
        self._rest = 30.0 + 120.0 * ((rows % 8 < 3) & (columns % 8 < 3))
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.cut.set()
        self._server.shutdown()
        self._server.server_close()

    @property
    def url(self) -> str:
        """Address of the stream."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/camera.mjpg"

    def _jpeg(self, rng: np.random.Generator) -> bytes:
        noise = rng.normal(0.0, 1.5, self._rest.shape)
        noisy = np.clip(self._rest + noise, 0, 255).astype(np.uint8)
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
                rng = np.random.default_rng(0)
                try:
                    while not camera.cut.wait(1.0 / FPS):
                        data = camera._jpeg(rng)
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
