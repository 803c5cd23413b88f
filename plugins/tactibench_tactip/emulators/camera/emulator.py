"""The camera emulator: an HTTP server that streams what the world looks like."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time
from threading import Lock

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_tactip.emulators.camera.picture import Picture
from tactibench_tactip.emulators.camera.streams import stream_named
from tactibench_tactip.emulators.device import Device
from tactibench_tactip.emulators.faults import Fault
from tactibench_tactip.emulators.world import World

KINDS = (
    "camera-stall",
    "camera-drop",
    "stale-frames",
    "black-frames",
    "brightness-jump",
    "pin-loss",
)
REQUEST_S = 2.0
"""Host seconds within which a client has sent its request."""


class CameraEmulator(Device):
    """``url`` is for ``cv2.VideoCapture(url, cv2.CAP_FFMPEG)``; frames come at ``fps`` of the
    host's clock, whatever the time scale, each showing the moment at which it is sent.

    stream: "mjpeg", or "lossless" (uncompressed gray, which FFmpeg reads as well). quality: of the
    JPEG, 1..100. noise: times the noise of a small CMOS camera, in every frame anew; 0: none.
    A client that does not read finds old frames waiting, as with a real one. A stream has no
    exposure or focus to set: ``set`` of those properties returns False. Raises UserError for a
    value that is not allowed.
    """

    def __init__(
        self,
        world: World,
        *,
        fps: float = 30.0,
        stream: str = "mjpeg",
        quality: int = 95,
        noise: float = 1.0,
        seed: int = 0,
        host: str = "127.0.0.1",
    ) -> None:
        super().__init__()
        if not (math.isfinite(fps) and 0 < fps <= 1000):
            raise UserError(f"the camera's rate is {fps:g} frames/s; it must be up to 1000.")
        if not (math.isfinite(noise) and noise >= 0):
            raise UserError(f"the camera's noise is {noise:g}; it must be 0 or more.")
        self.world, self.fps = world, fps
        self.picture = Picture(world.view.rest, noise, seed)
        self._stream = stream_named(stream, quality)
        self._stream.head(world.view.rest, fps)
        self._suffix = "mjpg" if stream == "mjpeg" else "y4m"
        self._host, self._port = host, 0
        self._server: socket.socket | None = None
        self._clients: set[socket.socket] = set()
        self._lock = Lock()
        self._until: dict[str, float] = {}
        self._stale: npt.NDArray[np.uint8] | None = None
        self._brighter = 0.0
        world.answer(KINDS, self._fault)

    @property
    def url(self) -> str:
        """Known once it has started; the port stays when it starts again."""
        return f"http://{self._host}:{self._port}/frame.{self._suffix}"

    def start(self) -> None:
        """Listen."""
        self._server = socket.create_server((self._host, self._port))
        self._port = self._server.getsockname()[1]
        self.run("camera", self._accept, self._server)

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        self.drop()

    def drop(self) -> None:
        """Close every connection; new ones are served."""
        with self._lock:
            for client in self._clients:
                with contextlib.suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)

    def frame(self) -> npt.NDArray[np.uint8]:
        """The frame of this moment: (H, W) or (H, W, 3)."""
        with self.world.lock:
            now = self.world.advance()
            on = {kind for kind, until in self._until.items() if now < until}
        if "stale-frames" in on and self._stale is not None:
            return self._stale
        return self._seen(self.world.image(), "black-frames" in on)

    def _seen(self, image: npt.NDArray[np.uint8], black: bool = False) -> npt.NDArray[np.uint8]:
        with self._lock:
            return self.picture.frame(image, self._brighter, black)

    def _accept(self, server: socket.socket) -> None:
        while not self.stopping.is_set():
            with contextlib.suppress(OSError, ValueError):
                if select.select([server], [], [], 0.1)[0]:
                    client, _ = server.accept()
                    with self._lock:
                        self._clients.add(client)
                    self.run("camera client", self._serve, client)

    def _serve(self, client: socket.socket) -> None:
        try:
            with contextlib.suppress(OSError):
                if self._asked(client):
                    self._send(client)
        finally:
            with self._lock:
                self._clients.discard(client)
            client.close()

    def _asked(self, client: socket.socket) -> bool:
        """Whether a whole GET request came."""
        client.settimeout(REQUEST_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        data = b""
        while b"\r\n\r\n" not in data and len(data) < 65536:
            more = client.recv(4096)
            if not more:
                return False
            data += more
        client.settimeout(None)  # ``drop`` ends a send that nobody takes
        return data.startswith(b"GET ")

    def _send(self, client: socket.socket) -> None:
        client.sendall(self._stream.head(self.world.view.rest, self.fps))
        due = time.monotonic()
        while not self.stopping.wait(max(0.0, due - time.monotonic())):
            due = max(due + 1 / self.fps, time.monotonic() - 1 / self.fps)
            if not self._stalled():
                client.sendall(self._stream.part(self.frame()))

    def _stalled(self) -> bool:
        with self.world.lock:
            return self.world.advance() < self._until.get("camera-stall", -math.inf)

    def _fault(self, fault: Fault, t: float) -> None:
        kind = fault.kind
        if kind == "camera-drop":
            self.drop()
        elif kind == "brightness-jump":
            self._brighter += 40.0 if fault.value is None else fault.value
        elif kind == "pin-loss":
            with self._lock:
                self.picture.lose(int(5 if fault.value is None else fault.value))
        else:
            default = math.inf if kind == "camera-stall" else 2.0
            self._until[kind] = t + (default if fault.value is None else fault.value)
            if kind == "stale-frames":
                self._stale = self._seen(self.world.view.image(self.world.truth_at(t).scene))
