"""A camera that shows the world: uncompressed frames over loopback HTTP."""

from __future__ import annotations

import math
import socket
import time
from fractions import Fraction
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from tactibench import UserError
from tactibench_tactip.emulators.device import Device, Fault
from tactibench_tactip.emulators.world import Image, World

REQUEST_S = 2.0
"""Host seconds within which a client has sent its request."""
NOISE_FIELDS = 8
"""Number of noise fields, which are drawn once; each frame takes one of them, shifted at random."""
READ_NOISE, FULL_WELL, WHITE = 1.5, 10_000.0, 255
"""The noise has the variance read^2 + 255 / full_well * grey (EMVA 1288, linear model), with the
read noise in grey levels rms and the full well in electrons. The values are assumed, as those of a
small CMOS pixel."""


class Picture:
    """Light, missing pins and noise that the camera adds to the sensor's image."""

    def __init__(self, rest: Image, noise: float, seed: int) -> None:
        """Find the pins and draw the noise fields.

        Args:
            rest: (H, W) image of the undeformed sensor, without noise.
            noise: Factor on the noise of a small camera; 0 gives none.
            seed: Seed of the noise and of the choice of lost pins.
        """
        self.brighter = 0.0
        self._rng = np.random.default_rng(seed)
        shape = (NOISE_FIELDS, *rest.shape)
        self._fields = self._rng.standard_normal(shape, dtype=np.float32) * np.float32(noise)
        self._noise = noise
        grey = np.arange(WHITE + 1, dtype=np.float32)
        self._deviation = np.sqrt(READ_NOISE**2 + WHITE / FULL_WELL * grey)
        self._pins = _find_pins(rest)[1]
        self._lost = np.zeros((0, 2))

    def lose(self, count: int) -> None:
        """Hide ``count`` more pins in all frames from now on."""
        left = [pin for pin in self._pins if not (self._lost == pin).all(axis=1).any()]
        picked = self._rng.permutation(len(left))[:count]
        self._lost = np.concatenate([self._lost, np.array(left)[picked].reshape(-1, 2)])

    def repair(self) -> None:
        """Put light and pins back as they were."""
        self.brighter, self._lost = 0.0, np.zeros((0, 2))

    def frame(self, image: Image, black: bool = False) -> Image:
        """Return one frame, (H, W) uint8, with noise of its own.

        Args:
            image: (H, W) image of the sensor, without noise.
            black: Whether the frame shows noise alone.
        """
        frame = np.zeros_like(image) if black else image
        if len(self._lost) and not black:
            frame = _without_pins(frame, self._lost)
        if self.brighter and not black:
            frame = _as_grey(frame.astype(np.float32) + self.brighter)
        if not self._noise:
            return frame
        field = self._fields[int(self._rng.integers(NOISE_FIELDS))]
        rolled = np.roll(field, tuple(self._rng.integers(0, 64, 2)), axis=(0, 1))
        return _as_grey(frame + self._deviation[frame] * rolled)


class CameraEmulator(Device):
    """Streams frames for ``cv2.VideoCapture(url, cv2.CAP_FFMPEG)``.

    Each frame shows the moment at which it is sent. The frames are a YUV4MPEG2 stream of gray
    images, from which FFmpeg returns exactly the same bytes. A client that does not read finds old
    frames waiting, as with a real camera; a stream has no exposure or focus to set.

    Args:
        world: The world to show.
        fps: Frames a second of the host's clock, whatever the time scale.
        noise: Factor on the noise of a small camera; 0 gives none.
        seed: Seed of the noise.

    Raises:
        UserError: The sensor shows colours.
    """

    def __init__(
        self, world: World, *, fps: float = 30.0, noise: float = 1.0, seed: int = 0
    ) -> None:
        super().__init__()
        if world.rest.ndim != 2:
            raise UserError("the emulated camera streams gray frames, the sensor shows colours.")
        self.world, self.fps = world, fps
        self.picture = Picture(world.rest, noise, seed)
        self._port = 0
        self._lock = Lock()
        self._until: dict[str, float] = {}
        self._stale: Image | None = None
        world.on_fault(
            {
                "camera-stall": self._begin_fault,
                "stale-frames": self._repeat_frame,
                "black-frames": self._begin_fault,
                "camera-drop": lambda _, __: self.hang_up(),
                "brightness-jump": self._brighten,
                "pin-loss": self._lose_pins,
            }
        )

    @property
    def url(self) -> str:
        """Address of the stream, known after the first start; later starts keep the port."""
        return f"http://127.0.0.1:{self._port}/frame.y4m"

    def start(self) -> None:
        """Listen for clients."""
        self._port = self.listen("127.0.0.1", self._port, self._talk)

    def frame(self) -> Image:
        """Return the frame of the present moment, (H, W) uint8."""
        with self.world.lock:
            now = self.world.advance()
            active = {kind for kind, until in self._until.items() if now < until}
        if "stale-frames" in active and self._stale is not None:
            return self._stale
        image = self.world.image()
        with self._lock:
            return self.picture.frame(image, "black-frames" in active)

    def _talk(self, client: socket.socket) -> None:
        if self._read_request(client):
            self._send_frames(client)

    def _read_request(self, client: socket.socket) -> bool:
        """Return whether a complete GET request was read."""
        client.settimeout(REQUEST_S)
        data = b""
        while b"\r\n\r\n" not in data and len(data) < 65536:
            more = client.recv(4096)
            if not more:
                return False
            data += more
        client.settimeout(None)  # ``hang_up`` ends a send that no client reads
        return data.startswith(b"GET ")

    def _send_frames(self, client: socket.socket) -> None:
        height, width = self.world.rest.shape
        rate = Fraction(self.fps).limit_denominator(1000)
        size = f"W{width} H{height} F{rate.numerator}:{rate.denominator}"
        http = (
            "HTTP/1.0 200 OK\r\nCache-Control: no-store\r\nContent-Type: video/x-yuv4mpeg\r\n\r\n"
        )
        head = f"{http}YUV4MPEG2 {size} Ip A1:1 Cmono XCOLORRANGE=FULL\n"
        client.sendall(head.encode())
        due = time.monotonic()
        while not self.stopping.wait(max(0.0, due - time.monotonic())):
            due = max(due + 1 / self.fps, time.monotonic() - 1 / self.fps)
            if not self._stalled():
                client.sendall(b"FRAME\n" + self.frame().tobytes())

    def _stalled(self) -> bool:
        with self.world.lock:
            return self.world.advance() < self._until.get("camera-stall", -math.inf)

    def _begin_fault(self, fault: Fault, t: float) -> None:
        self._until[fault.kind] = t + fault.amount

    def _repeat_frame(self, fault: Fault, t: float) -> None:
        self._begin_fault(fault, t)
        image = self.world.image_at(t)
        with self._lock:
            self._stale = self.picture.frame(image)

    def _brighten(self, fault: Fault, _: float) -> None:
        self.picture.brighter += fault.amount

    def _lose_pins(self, fault: Fault, _: float) -> None:
        with self._lock:
            self.picture.lose(int(fault.amount))


def _as_grey(values: npt.NDArray[Any]) -> Image:
    result: Image = np.clip(np.rint(values), 0, WHITE).astype(np.uint8)
    return result


def _find_pins(image: Image) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Return labels (H, W) and centres (N, 2), px, of the blobs.

    Blobs are on the rarer side of Otsu's threshold.
    """
    import cv2  # the commands of this plugin start without it

    _, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    if mask.mean() > WHITE / 2:
        mask = cv2.bitwise_not(mask)
    _, labels, _, centres = cv2.connectedComponentsWithStats(mask)
    return np.asarray(labels), np.asarray(centres[1:], dtype=np.float64)


def _without_pins(image: Image, places: npt.NDArray[np.float64]) -> Image:
    """Return the image without the blobs nearest to places (N, 2), px; each is taken once."""
    labels, centres = _find_pins(image)
    gone = np.zeros(labels.shape, dtype=np.uint8)
    free = np.ones(len(centres), dtype=bool)
    for place in places[: len(centres)]:
        distance = np.where(free, np.hypot(*(centres - place).T), np.inf)
        nearest = int(distance.argmin())
        free[nearest] = False
        gone |= (labels == nearest + 1).astype(np.uint8)
    gone = np.asarray(ndimage.grey_dilation(gone, size=(3, 3)))
    result = image.copy()
    result[gone > 0] = np.uint8(np.median(image[labels == 0]))
    return result
