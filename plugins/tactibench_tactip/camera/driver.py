"""A camera whose frames are known to be fresh.

A thread takes every frame as it comes, so that none waits in a buffer, and notes the time right
after the driver handed it over. Frames are decoded only while somebody waits for them.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np

from tactibench_tactip.camera.source import Image, Open, ReadBack, configure, open_capture
from tactibench_tactip.failures import CameraError
from tactibench_tactip.settings import CameraKeys

OPENING_S = 15.0
REOPENED_S = 5.0


@dataclass(frozen=True, eq=False)
class Shot:
    """image: (H, W) uint8, grey. t_ns: ``time.monotonic_ns`` when it was taken."""

    image: Image
    t_ns: int


class Camera:
    """Opened on entry; the thread begins then. Raises CameraError when frames stop coming.

    period_s: between two frames, as measured; the configuration's until then.
    """

    def __init__(self, keys: CameraKeys, opened: Open = open_capture) -> None:
        self._keys = keys
        self._open = opened
        self._news = threading.Condition()
        self._shots: list[Shot] = []
        self._wanted = 0
        self._taken_ns = 0
        self._count = 0
        self._failed = ""
        self._started_ns = 0
        self._run = 0
        self._gaps: list[float] = []
        self.read_back: ReadBack | None = None
        self.reopened = 0

    def __enter__(self) -> Self:
        self._begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._news:
            self._run += 1  # whichever thread runs has nothing to do any more

    @property
    def period_s(self) -> float:
        with self._news:
            gaps = sorted(self._gaps)
        return gaps[len(gaps) // 2] if len(gaps) >= 10 else 1.0 / self._keys.fps

    @property
    def frames(self) -> int:
        """How many came so far."""
        return self._count

    def alive(self) -> bool:
        """Whether a frame came within ``stall_s``."""
        return (time.monotonic_ns() - self._taken_ns) * 1e-9 < self._keys.stall_s

    def fresh(self, after_ns: int, count: int = 1) -> list[Shot]:
        """``count`` frames in a row taken after a moment of ``time.monotonic_ns``.

        A stalled camera is opened once more. Raises CameraError when that does not help.
        """
        try:
            return self._wait(after_ns, count)
        except CameraError:
            if self.reopened:
                raise
        self.reopened += 1
        self._begin()
        found = self._wait(after_ns, count)
        self.reopened = 0
        return found

    def after(self, end_ns: int, count: int = 1) -> list[Shot]:
        """Frames that were begun after a moment: taken a whole frame period after it."""
        return self.fresh(end_ns + int(1e9 * self.period_s), count)

    def now(self) -> Shot:
        """The next frame that comes."""
        return self.fresh(time.monotonic_ns(), 1)[0]

    def _wait(self, after_ns: int, count: int) -> list[Shot]:
        stall = self._keys.stall_s
        with self._news:
            self._wanted += 1
            self._shots = [shot for shot in self._shots if shot.t_ns >= after_ns][-count:]
            try:
                while True:
                    good = [shot for shot in self._shots if shot.t_ns >= after_ns]
                    if len(good) >= count:
                        return good[:count]
                    due = max(self._taken_ns, self._started_ns, after_ns) * 1e-9 + stall
                    left = due - time.monotonic()
                    if self._failed:
                        raise CameraError(self._failed)
                    if left <= 0:
                        raise CameraError(
                            f"the camera {self._keys.source!r} gave no frame for {stall:g} s; "
                            "check its cable."
                        )
                    self._news.wait(left)
            finally:
                self._wanted -= 1
                if not self._wanted:
                    self._shots = []

    def _begin(self) -> None:
        """Start a thread that opens the camera; one that hangs in it is left behind."""
        with self._news:
            self._run += 1
            run = self._run
            self._failed, self._shots = "", []
            self._started_ns = time.monotonic_ns()
        ready = threading.Event()
        failure: list[BaseException] = []
        threading.Thread(
            target=self._drain, args=(run, ready, failure), name="tactip camera", daemon=True
        ).start()
        if not ready.wait(OPENING_S):
            raise CameraError(
                f"the camera {self._keys.source!r} did not open within {OPENING_S:g} s."
            )
        if failure:
            raise failure[0]
        self._started_ns = time.monotonic_ns()

    def _drain(self, run: int, ready: threading.Event, failure: list[BaseException]) -> None:
        capture: Any = None
        try:
            capture = self._open(self._keys)
            found = configure(capture, self._keys)
        except BaseException as error:  # noqa: BLE001 - raised again by who waits
            failure.append(error)
            ready.set()
            if capture is not None:
                capture.release()
            return
        self.read_back = self.read_back or found
        ready.set()
        try:
            while self._run == run and self._take(capture, run):
                pass
        finally:
            capture.release()

    def _take(self, capture: Any, run: int) -> bool:
        """One frame; whether there may be more."""
        if not capture.grab():
            self._end(run, f"the camera {self._keys.source!r} sends no more frames.")
            return False
        t_ns = time.monotonic_ns()
        wanted = self._wanted > 0
        image = self._decoded(capture) if wanted else None
        with self._news:
            if self._run != run:
                return False
            if self._taken_ns:
                self._gaps = [*self._gaps[-50:], (t_ns - self._taken_ns) * 1e-9]
            self._taken_ns = t_ns
            self._count += 1
            if image is not None:
                self._shots = [*self._shots[-64:], Shot(image, t_ns)]
                self._news.notify_all()
        return True

    def _decoded(self, capture: Any) -> Image | None:
        good, picture = capture.retrieve()
        if not good or picture is None:
            return None
        image = _grey(np.asarray(picture, dtype=np.uint8))
        if self._keys.crop is not None:
            x, y, width, height = self._keys.crop
            image = image[y : y + height, x : x + width]
            if image.shape != (height, width):
                return None
        return np.ascontiguousarray(image)

    def _end(self, run: int, why: str) -> None:
        with self._news:
            if self._run == run:
                self._failed = why
                self._news.notify_all()


def _grey(image: Image) -> Image:
    """OpenCV hands frames over as blue, green, red."""
    import cv2

    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
