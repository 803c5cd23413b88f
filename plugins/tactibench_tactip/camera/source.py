"""Opening a camera with the settings that are asked for, read back."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_tactip.failures import CameraError
from tactibench_tactip.settings import CameraKeys

Image = npt.NDArray[np.uint8]
Open = Callable[[CameraKeys], Any]
"""Makes something like a ``cv2.VideoCapture``; raises CameraError."""

MANUAL_V4L2, MANUAL_OTHER = 1.0, 0.25
"""Of CAP_PROP_AUTO_EXPOSURE: V4L2 of OpenCV 4 and later takes the kernel's menu (1 manual,
3 aperture priority); other backends keep the normalised values of OpenCV 3."""


@dataclass(frozen=True)
class ReadBack:
    """What the camera says it does. NaN-free, so that it can be written and compared."""

    backend: str
    width: int
    height: int
    fps: float
    fourcc: str
    exposure: float
    auto_exposure: float
    gain: float


def open_capture(keys: CameraKeys) -> Any:
    """A ``cv2.VideoCapture`` of the configuration's source. Raises CameraError."""
    import cv2

    source = keys.source
    if isinstance(source, str) and "://" in source:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 3000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 1500]
        capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
    elif sys.platform == "linux" and (isinstance(source, int) or source.startswith("/dev/")):
        device = source if isinstance(source, int) else str(Path(source).resolve())
        if isinstance(source, str) and not Path(source).exists():
            raise CameraError(_not_there(source))
        capture = cv2.VideoCapture(device, cv2.CAP_V4L2)
    else:
        capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        raise CameraError(_not_there(source))
    return capture


def _not_there(source: str | int) -> str:
    return (
        f"the camera {source!r} cannot be opened; check camera.source (see `tactibench hw list`) "
        "and that no other program uses it."
    )


def configure(capture: Any, keys: CameraKeys) -> ReadBack:
    """Set what the configuration names and read all back. Raises UserError for what is not so."""
    import cv2

    if keys.fourcc is not None:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*keys.fourcc))
    if keys.size is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, keys.size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, keys.size[1])
    stream = isinstance(keys.source, str) and "://" in keys.source
    if not stream:
        capture.set(cv2.CAP_PROP_FPS, keys.fps)
    if keys.exposure is not None:
        _manual(capture, keys)
        _set(capture, cv2.CAP_PROP_EXPOSURE, keys.exposure, "camera.exposure")
    if keys.gain is not None:
        _set(capture, cv2.CAP_PROP_GAIN, keys.gain, "camera.gain")
    found = read_back(capture)
    if keys.size is not None and (found.width, found.height) != keys.size:
        raise UserError(
            f"the camera gives frames of {found.width} x {found.height} px, camera.size asks for "
            f"{keys.size[0]} x {keys.size[1]}; name a size that it has."
        )
    if keys.fourcc is not None and not stream and found.fourcc != keys.fourcc:
        raise UserError(
            f"the camera sends {found.fourcc!r}, camera.fourcc asks for {keys.fourcc!r}; name a "
            "format that it has, such as MJPG or YUYV."
        )
    return found


def read_back(capture: Any) -> ReadBack:
    import cv2

    def get(name: int) -> float:
        value = float(capture.get(name))
        return value if np.isfinite(value) else -1.0

    code = int(get(cv2.CAP_PROP_FOURCC))
    letters = "".join(chr((code >> 8 * k) & 0xFF) for k in range(4)) if code > 0 else ""
    return ReadBack(
        str(capture.getBackendName()),
        int(get(cv2.CAP_PROP_FRAME_WIDTH)),
        int(get(cv2.CAP_PROP_FRAME_HEIGHT)),
        get(cv2.CAP_PROP_FPS),
        letters if letters.isprintable() else "",
        get(cv2.CAP_PROP_EXPOSURE),
        get(cv2.CAP_PROP_AUTO_EXPOSURE),
        get(cv2.CAP_PROP_GAIN),
    )


def _manual(capture: Any, keys: CameraKeys) -> None:
    """Switch automatic exposure off. Raises UserError when it stays on."""
    import cv2

    manual = MANUAL_V4L2 if capture.getBackendName() == "V4L2" else MANUAL_OTHER
    accepted = capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, manual)
    found = float(capture.get(cv2.CAP_PROP_AUTO_EXPOSURE))
    if not accepted or abs(found - manual) > 1e-3:
        raise UserError(
            f"the camera {keys.source!r} does not switch its automatic exposure off "
            f"({capture.getBackendName()} says {found:g}); switch it off with the maker's tool or "
            "v4l2-ctl and leave camera.exposure out, or take another camera: frames whose "
            "brightness follows the contact teach a model the wrong thing."
        )


def _set(capture: Any, name: int, value: float, key: str) -> None:
    accepted = capture.set(name, value)
    found = float(capture.get(name))
    if not accepted or abs(found - value) > 1e-3 + 0.01 * abs(value):
        raise UserError(
            f"{key} is {value:g}, but the camera stays at {found:g}; name a value that it takes "
            "(v4l2-ctl --list-ctrls shows them), or leave the key out."
        )
