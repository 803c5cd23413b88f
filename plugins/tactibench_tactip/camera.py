"""A camera whose frames are known to be fresh, and the check of a press's frames.

A thread takes every frame as it comes, so that none waits in a buffer, and notes the time right
after the driver handed it over. A frame that was there before, to the last bit, is no frame: noise
makes every image of a camera another one. The frames of a press are compared with the undeformed
sensor.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_tactip.geometry import Array
from tactibench_tactip.settings import CameraSettings, SensorSettings

Image = npt.NDArray[np.uint8]
OpenCapture = Callable[[CameraSettings], Any]
"""A function that opens something like a ``cv2.VideoCapture``, or raises CameraError."""

SATURATED = 250
"""Grey level from which a pixel counts as saturated: noise keeps full ones a little below 255."""
MOST_SATURATED = 0.01
"""Share of the frame that may saturate under a press: more is glare, and pins in it are lost."""
BRIGHTNESS = 0.10
"""Share by which the mean brightness may differ from that of the undeformed sensor."""
ALIKE_LEVELS = 6.0
"""Mean difference, grey levels, that two looks at the undeformed sensor may have."""
MOTION = 1.5
"""Factor on the difference of two frames at rest by which two frames of a press may differ."""
SEEN_MM = 0.5
"""Depth from which on a press must be visible in the frame."""
RELAXED = 0.3
"""Share of a press's change that a frame after it may still show."""
RELAXED_LEVELS = 0.3
"""Least value of that limit, grey levels, where the press itself changed little."""
OPENING_S = 15.0
CLOSING_S = 12.0
"""Time for which a closing camera waits for its threads: OpenCV aborts the process (exit code 134)
where a thread returns from a stream when Python ends. Opening a stream takes up to 3 s, a V4L2
camera waits 10 s for a frame. A driver that hangs for longer is left behind."""
KEPT_S = 4.0
"""Time for which frames are kept for who asks later, as after a press how it began to show."""
REMEMBERED = 1000
"""Frames that a repeated one is compared with: buffers that are sent again and again are fewer."""
FILLED_S = 1.0
"""Time after the opening of a stream whose frames may have waited in its buffer."""
RATE = 0.2
"""Share by which the rate of frames may differ from ``camera.fps``."""
MANUAL_V4L2, MANUAL_OTHER = 1.0, 0.25
"""Values of CAP_PROP_AUTO_EXPOSURE: V4L2 of OpenCV 4 and later takes the kernel's menu (1 manual,
3 aperture priority); other backends keep the normalised values of OpenCV 3."""


class DeviceError(UserError):
    """A device did not do what it was asked to do; it cannot be used further in this session."""


class CameraError(DeviceError):
    """The camera gives no frames, or not those that it was asked for."""


@dataclass(frozen=True)
class ReadBack:
    """Settings as the camera reports them, without NaN: they are written and compared."""

    backend: str
    width: int
    height: int
    fps: float
    fourcc: str
    exposure: float
    auto_exposure: float
    gain: float


def open_capture(settings: CameraSettings) -> Any:
    """Return a ``cv2.VideoCapture`` of the configuration's source.

    Raises:
        CameraError: The source cannot be opened.
    """
    import cv2

    source = settings.source
    if isinstance(source, str) and "://" in source:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 3000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 1500]
        capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
        if read_back(capture).fourcc == "MJPG":
            # As they were sent: OpenCV scales a frame of another size to that of the first one.
            capture.set(cv2.CAP_PROP_FORMAT, -1)
    elif sys.platform == "linux" and (isinstance(source, int) or source.startswith("/dev/")):
        device = source if isinstance(source, int) else str(Path(source).resolve())
        capture = cv2.VideoCapture(device, cv2.CAP_V4L2)
    else:
        capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        raise CameraError(
            f"the camera {source!r} cannot be opened; check camera.source (`ls /dev/v4l/by-id`) "
            "and that no other program uses it."
        )
    return capture


def configure(capture: Any, settings: CameraSettings) -> ReadBack:
    """Set what the configuration names and return all settings, read back.

    Frames whose brightness follows the contact, or of another size, teach a model the wrong thing.

    Raises:
        UserError: The camera does not take a setting, or the crop reaches beyond its frames.
    """
    import cv2

    if settings.fourcc is not None:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc))
    if settings.size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.size[1])
    is_stream = isinstance(settings.source, str) and "://" in settings.source
    if not is_stream:
        capture.set(cv2.CAP_PROP_FPS, settings.fps)
    if settings.exposure is not None:
        manual = MANUAL_V4L2 if capture.getBackendName() == "V4L2" else MANUAL_OTHER
        if not _takes(capture, cv2.CAP_PROP_AUTO_EXPOSURE, manual):
            raise UserError(
                f"the camera {settings.source!r} does not switch its automatic exposure off; "
                "switch it off with the maker's tool or v4l2-ctl and leave camera.exposure out, or "
                "take another camera."
            )
    for key, name in (("exposure", cv2.CAP_PROP_EXPOSURE), ("gain", cv2.CAP_PROP_GAIN)):
        value = getattr(settings, key)
        if value is not None and not _takes(capture, name, value):
            raise UserError(
                f"camera.{key} is {value:g}, but the camera stays at {capture.get(name):g}; name a "
                "value that it takes (v4l2-ctl --list-ctrls shows them), or leave the key out."
            )
    actual = read_back(capture)
    if settings.size is not None and (actual.width, actual.height) != settings.size:
        raise UserError(
            f"the camera gives frames of {actual.width} x {actual.height} px, camera.size asks for "
            f"{settings.size[0]} x {settings.size[1]}; name a size that it has."
        )
    if settings.crop is not None and actual.width > 0:
        x, y, width, height = settings.crop
        if x + width > actual.width or y + height > actual.height:
            raise UserError(
                f"camera.crop reaches to {x + width} x {y + height} px, the camera gives frames of "
                f"{actual.width} x {actual.height} px; name a crop inside them."
            )
    if settings.fourcc is not None and not is_stream and actual.fourcc != settings.fourcc:
        raise UserError(
            f"the camera sends {actual.fourcc!r}, camera.fourcc asks for {settings.fourcc!r}; name "
            "a format that it has, such as MJPG or YUYV."
        )
    return actual


def read_back(capture: Any) -> ReadBack:
    """Return the settings that an open capture reports."""
    import cv2

    def get(name: int) -> float:
        value = float(capture.get(name))
        return value if np.isfinite(value) else -1.0

    code = int(get(cv2.CAP_PROP_FOURCC))
    letters = "".join(chr((code >> 8 * k) & 0xFF) for k in range(4)) if code > 0 else ""
    return ReadBack(
        backend=str(capture.getBackendName()),
        width=int(get(cv2.CAP_PROP_FRAME_WIDTH)),
        height=int(get(cv2.CAP_PROP_FRAME_HEIGHT)),
        fps=get(cv2.CAP_PROP_FPS),
        fourcc=letters if letters.isprintable() else "",
        exposure=get(cv2.CAP_PROP_EXPOSURE),
        auto_exposure=get(cv2.CAP_PROP_AUTO_EXPOSURE),
        gain=get(cv2.CAP_PROP_GAIN),
    )


def _takes(capture: Any, name: int, value: float) -> bool:
    """Set a property, and return whether the camera then has it."""
    accepted = capture.set(name, value)
    return bool(accepted) and abs(float(capture.get(name)) - value) <= 1e-3 + 0.01 * abs(value)


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """A frame and its time.

    Attributes:
        image: (H, W) uint8, grey.
        t_ns: ``time.monotonic_ns`` at which it was taken.
    """

    image: Image
    t_ns: int


class Camera:
    """A camera that takes frames from entry to exit.

    On entry, CameraError is raised where it does not open, UserError where it does not take its
    settings.

    Attributes:
        frames: Number of frames so far.
        read_back: Settings as the camera reports them; None before it is open.
    """

    def __init__(self, settings: CameraSettings, open_: OpenCapture = open_capture) -> None:
        self._settings = settings
        self._open = open_
        self._news = threading.Condition()
        self._threads: list[threading.Thread] = []
        self._frames: deque[CameraFrame] = deque(maxlen=int(KEPT_S * settings.fps) + 1)
        self._taken_ns = self._started_ns = 0
        self._run = self._repeats = 0
        self._failure = ""
        self._gaps_s: deque[float] = deque(maxlen=self._frames.maxlen)
        self._seen: deque[int] = deque(maxlen=REMEMBERED)
        self._shape = None if settings.size is None else settings.size[::-1]
        self.frames = 0
        self.read_back: ReadBack | None = None

    def __enter__(self) -> Self:
        try:
            self._begin()
        except BaseException:  # also Ctrl-C while it opens
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._run += 1  # ends the threads that take frames
        try:
            self._join()
        except KeyboardInterrupt:  # an impatient Ctrl-C must not make the process abort
            self._join()
            raise

    def _join(self) -> None:
        """Wait for the threads that take frames, also those from before a reopening."""
        end = time.monotonic() + CLOSING_S
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))

    @property
    def is_open(self) -> bool:
        """Whether it was opened."""
        return self.read_back is not None

    @property
    def late_s(self) -> float:
        """Time by which a frame may show the past: ``lag_s``, and the longest of the last gaps."""
        with self._news:
            return self._settings.lag_s + max(self._gaps_s, default=1.0 / self._settings.fps)

    def check_alive(self) -> None:
        """Raise CameraError where no new frame came within the last ``stall_s``."""
        if (time.monotonic_ns() - self._taken_ns) * 1e-9 >= self._settings.stall_s:
            raise CameraError(self._stalled())

    def check_rate(self) -> float:
        """Return the rate of new frames, or raise CameraError: it is not the configuration's.

        A machine that was busy for a moment must not count: frames then are lost, so that the two
        longest gaps tell nothing, or come all at once, so that only with these the rate is right.
        """
        fps = self._settings.fps
        with self._news:
            gaps = sorted(self._gaps_s) or [1.0 / fps]
        rate, steady = (len(some) / sum(some) for some in (gaps, gaps[:-2] or gaps))
        if rate > (1.0 + RATE) * fps or steady < (1.0 - RATE) * fps:
            raise CameraError(
                f"the camera sends {rate:.1f} new frames a second, camera.fps is {fps:g}; shorten "
                "camera.exposure, take MJPG in place of YUYV or another USB port, or correct "
                "camera.fps."
            )
        return rate

    def since(self, begin_ns: int) -> list[CameraFrame]:
        """Return the frames of the last KEPT_S that were taken from a moment on."""
        with self._news:
            return [frame for frame in self._frames if frame.t_ns >= begin_ns]

    def fresh(self, after_ns: int, count: int = 1) -> list[CameraFrame]:
        """Return ``count`` frames in a row, taken after a moment of ``time.monotonic_ns``.

        A stalled camera is opened once more.

        Raises:
            CameraError: The camera gives no frames, also after it was opened again.
        """
        try:
            return self._wait(after_ns, count)
        except CameraError:
            self._begin()
            return self._wait(after_ns, count)

    def after(self, end_ns: int, count: int = 1) -> list[CameraFrame]:
        """Return ``count`` frames that show what was after a moment of ``time.monotonic_ns``."""
        frames = self.fresh(end_ns + int(1e9 * self.late_s), count)
        # A stream that paused meanwhile may go on later than it was before.
        while frames[0].t_ns < end_ns + int(1e9 * self.late_s):
            frames = self.fresh(end_ns + int(1e9 * self.late_s), count)
        return frames

    def now(self) -> CameraFrame:
        """Return the next frame that comes."""
        return self.fresh(time.monotonic_ns(), 1)[0]

    def _wait(self, after_ns: int, count: int) -> list[CameraFrame]:
        stall, begun_ns = self._settings.stall_s, after_ns
        frames: list[CameraFrame] = []
        with self._news:
            while len(frames) < count:
                new = [frame for frame in self._frames if frame.t_ns >= after_ns]
                if new:
                    frames += new
                    after_ns = new[-1].t_ns + 1
                    continue
                if self._failure:
                    raise CameraError(self._failure)
                last_ns = max(self._taken_ns, self._started_ns, begun_ns)
                left = last_ns * 1e-9 + stall - time.monotonic()
                if left <= 0:
                    raise CameraError(self._stalled())
                self._news.wait(left)
        return frames[:count]

    def _stalled(self) -> str:
        """Return the sentence about a camera that gives no new frame."""
        camera = f"the camera {self._settings.source!r}"
        if self._repeats:
            return (
                f"{camera} is frozen: it repeats frames, the same to the last bit; put its plug in "
                "again, and look whether it sees light."
            )
        return (
            f"{camera} gave no frame for {self._settings.stall_s:g} s that can be read; check its "
            "cable, camera.crop and camera.fourcc."
        )

    def _begin(self) -> None:
        """Start a thread that opens the camera; a thread that hangs there is left behind."""
        with self._news:
            self._run += 1
            run = self._run
            self._failure = ""
            self._frames.clear()
            self._taken_ns = 0
            self._started_ns = time.monotonic_ns()
        ready = threading.Event()
        failures: list[BaseException] = []
        thread = threading.Thread(
            target=self._take_all, args=(run, ready, failures), name="tactip camera", daemon=True
        )
        self._threads = [*(old for old in self._threads if old.is_alive()), thread]
        thread.start()
        if not ready.wait(OPENING_S):
            raise CameraError(
                f"the camera {self._settings.source!r} did not open within {OPENING_S:g} s."
            )
        if failures:
            raise failures[0]
        self._started_ns = time.monotonic_ns()

    def _take_all(self, run: int, ready: threading.Event, failures: list[BaseException]) -> None:
        capture: Any = None
        try:
            capture = self._open(self._settings)
            actual = configure(capture, self._settings)
            before = self.read_back = self.read_back or actual
            if actual.fourcc != before.fourcc:
                raise CameraError(
                    f"the camera now sends {actual.fourcc!r}, it began with {before.fourcc!r}; "
                    "name camera.fourcc, then go on with the same command."
                )
        except BaseException as error:  # noqa: BLE001 - raised again by the caller
            failures.append(error)
        ready.set()
        try:
            while not failures and self._run == run and self._take(capture, run):
                pass
        finally:
            if capture is not None:
                capture.release()

    def _take(self, capture: Any, run: int) -> bool:
        """Take one frame, and return whether there may be more."""
        grabbed = capture.grab()
        t_ns = time.monotonic_ns()
        picture = _decode(capture) if grabbed else None
        with self._news:
            if self._run != run:
                return False
            if not grabbed:
                self._failure = f"the camera {self._settings.source!r} sends no more frames."
            elif picture is not None:
                self._note(picture, t_ns)
            self._news.notify_all()
        return not self._failure

    def _note(self, picture: Image, t_ns: int) -> None:
        """Keep a frame, unless it was there before; one of another size ends the stream."""
        before = self._shape = self._shape or picture.shape
        if picture.shape != before:
            (height, width), (rows, columns) = picture.shape, before
            self._failure = (
                f"the camera sends frames of {width} x {height} px, not of {columns} x {rows} px "
                "as before; set its size, then go on with the same command."
            )
            return
        if self._settings.crop is not None:
            x, y, width, height = self._settings.crop
            picture = np.ascontiguousarray(picture[y : y + height, x : x + width])
            if picture.shape != (height, width):
                return
        key = hash(picture.tobytes())
        if key in self._seen and not self._settings.noiseless:
            self._repeats += 1
            return
        self._seen.append(key)
        self._repeats = 0
        if self._taken_ns > self._started_ns + 1e9 * FILLED_S:
            self._gaps_s.append((t_ns - self._taken_ns) * 1e-9)
        self._taken_ns = t_ns
        self.frames += 1
        self._frames.append(CameraFrame(picture, t_ns))


def _decode(capture: Any) -> Image | None:
    """Return the frame that was grabbed, (H, W) grey; None where it cannot be read."""
    import cv2

    good, picture = capture.retrieve()
    if good and picture is not None and picture.shape[0] == 1:  # as it was sent, not decoded
        picture = cv2.imdecode(picture, cv2.IMREAD_COLOR)
    if not good or picture is None:
        return None
    image = np.asarray(picture, dtype=np.uint8)
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


@dataclass(frozen=True, eq=False)
class Reference:
    """The undeformed sensor.

    Attributes:
        mean: (H, W) mean of the frames, grey levels.
        between: Mean absolute difference of two frames in a row.
        change: Mean absolute difference of one frame from the mean.
        change_std: Standard deviation of the change over frames.
        pins: Number of pins in the mean.
    """

    mean: Array
    between: float
    change: float
    change_std: float
    pins: int

    @classmethod
    def of(cls, frames: Sequence[CameraFrame]) -> Reference:
        """Return the reference of frames of the undeformed sensor."""
        images = np.stack([frame.image for frame in frames]).astype(np.float32)
        mean = images.mean(axis=0).astype(np.float64)
        changes = [_change(image, mean) for image in images]
        # The mean holds 1 / n of every frame, so that each looks closer to it than a new frame.
        grow = (1.0 + 1.0 / len(images)) / (1.0 - 1.0 / len(images))
        return cls(
            mean=mean,
            between=float(np.mean([float(np.abs(b - a).mean()) for a, b in pairwise(images)])),
            change=float(np.mean(changes)) * grow**0.5,
            change_std=float(np.std(changes)),
            pins=count_pins(np.rint(mean).astype(np.uint8)),
        )

    @property
    def brightness(self) -> float:
        """Mean grey level."""
        return float(self.mean.mean())

    @property
    def image(self) -> Image:
        """The mean as (H, W) uint8."""
        return np.rint(self.mean).astype(np.uint8)

    @property
    def threshold(self) -> float:
        """Change that noise does not reach: its mean, 5 deviations, and a little for LEDs."""
        return self.change + 5.0 * self.change_std + 0.02

    def change_of(self, image: Image) -> float:
        """Return the mean absolute difference from the undeformed sensor, grey levels.

        A change that all pixels share, as light makes it, is not counted.
        """
        return _change(image, self.mean)

    def change_after(self, press: Image) -> float:
        """Return the largest change, grey levels, of a frame that no longer shows a press."""
        share = RELAXED * (self.change_of(press) - self.change)
        return self.change + max(RELAXED_LEVELS, share)

    def check_alike(self, before: npt.NDArray[Any], when: str) -> None:
        """Raise CameraError where the undeformed sensor looks otherwise than before.

        Args:
            before: (H, W) mean of the frames before.
            when: A few words about when that was.
        """
        difference, bright = float(np.abs(self.mean - before).mean()), float(before.mean())
        if is_other_light(self.brightness, bright) or difference > ALIKE_LEVELS:
            raise CameraError(
                f"the undeformed sensor differs by {difference:.1f} grey levels from {when} "
                f"({self.brightness:.1f} grey levels bright, it was {bright:.1f}): the light or "
                "the exposure changed, or the camera moved; put that back, then go on with the "
                "same command."
            )

    def check_pins(self, sensor: SensorSettings) -> None:
        """Raise UserError where the count of pins is not the configuration's."""
        if not sensor.allows(self.pins):
            raise UserError(
                f"the undeformed sensor shows {self.pins} pins, sensor.pins says {sensor.pins}; "
                "draw the tool away, look at light, focus and camera.crop (`tactibench hw live` "
                "shows the frame), or correct sensor.pins."
            )


@dataclass(frozen=True, eq=False)
class FrameCheck:
    """The frames of one press, joined and checked.

    Attributes:
        reason: Why they cannot be used; "" where they can.
        image: (H, W) median.
        t_ns: Time of the middle frame.
        saturated: Share of saturated pixels.
        pins: Number of pins; -1 where they are not counted.
    """

    reason: str
    image: Image
    t_ns: int
    saturated: float
    pins: int


def check_frames(
    frames: Sequence[CameraFrame], reference: Reference, sensor: SensorSettings, depth_mm: float
) -> FrameCheck:
    """Return the frames of one press, joined and checked.

    Args:
        frames: Frames in a row.
        reference: The undeformed sensor.
        sensor: Configuration of the sensor.
        depth_mm: Depth of the press.
    """
    image = np.median(np.stack([frame.image for frame in frames]), axis=0).astype(np.uint8)
    pins = -1 if sensor.pins is None else count_pins(image)
    brightness, saturated = float(image.mean()), float((image >= SATURATED).mean())
    more = saturated - float((reference.mean >= SATURATED).mean())
    between = max(
        float(np.abs(b.image.astype(np.float32) - a.image).mean()) for a, b in pairwise(frames)
    )
    # Of the frames one by one: their median has less noise than those of the threshold.
    change = np.mean([reference.change_of(frame.image) for frame in frames])
    reasons = {
        f"brightness {brightness:.1f}, at rest {reference.brightness:.1f}: the light or the "
        "exposure changed": is_other_light(brightness, reference.brightness),
        f"{more:.1%} of the pixels are saturated": more > MOST_SATURATED,
        f"{pins} pins are seen, sensor.pins is {sensor.pins}": not sensor.allows(pins),
        "frames in a row are the same to the last bit: the camera repeats itself": between == 0
        and reference.between > 0,
        f"frames in a row differ by {between:.2f} grey levels: something still moves": between
        > MOTION * reference.between + 0.2,
        f"no contact is seen at {depth_mm:.1f} mm": depth_mm >= SEEN_MM
        and change < reference.threshold,
    }
    reason = next((text for text, is_wrong in reasons.items() if is_wrong), "")
    return FrameCheck(reason, image, frames[len(frames) // 2].t_ns, saturated, pins)


def is_other_light(brightness: float, at_rest: float) -> bool:
    """Return whether two mean brightnesses, grey levels, differ by more than a press explains."""
    return abs(brightness - at_rest) > BRIGHTNESS * max(1.0, at_rest)


def _change(image: npt.NDArray[Any], mean: Array) -> float:
    difference = image - mean
    return float(np.abs(difference - difference.mean()).mean())


def count_pins(image: Image) -> int:
    """Return the number of bright blobs that may be pins; 0 where there are none."""
    from tactibench import markers  # compiles code, which the process of a UR never needs

    try:
        return markers.count_pins(image)
    except UserError:
        return 0
