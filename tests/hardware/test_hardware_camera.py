"""Frames are fresh, settings are what was asked for, frames that cannot be kept are not."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from fake_station import FakeCapture

from tactibench import UserError
from tactibench_tactip import (
    Camera,
    CameraError,
    CameraFrame,
    CameraSettings,
    Reference,
    SensorSettings,
    check_frames,
    configure,
    open_capture,
)

SETTINGS = CameraSettings(source="fake", fps=500.0, stall_s=0.4, lag_s=0.0)


def test_no_frame_may_show_what_was_before_the_moment(
    camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Camera, "late_s", 0.02)
    with camera:
        for _ in range(3):
            moment = time.monotonic_ns()
            times = [frame.t_ns for frame in camera.after(moment, 3)]
            assert times == sorted(set(times))
            assert times[0] >= moment + 20_000_000


def test_a_stalled_camera_is_opened_once_more(capture: FakeCapture) -> None:
    opened: list[FakeCapture] = []

    def fresh_one(_: CameraSettings) -> FakeCapture:
        opened.append(capture if not opened else FakeCapture())
        return opened[-1]

    with Camera(SETTINGS, fresh_one) as camera:
        camera.now()
        capture.stalled.set()
        assert camera.now().image.shape == (48, 48)
        assert len(opened) == 2
        capture.stalled.clear()


def test_a_camera_that_stays_stalled_is_an_error(capture: FakeCapture) -> None:
    with Camera(SETTINGS, lambda _: capture) as camera:
        camera.now()
        capture.stalled.set()
        with pytest.raises(CameraError, match=r"no frame for 0\.4 s"):
            camera.now()
        with pytest.raises(CameraError, match="gave no frame"):
            camera.check_alive()
        capture.stalled.clear()


def test_a_stream_that_ends_is_opened_again_then_given_up(capture: FakeCapture) -> None:
    with Camera(SETTINGS, lambda _: capture) as camera:
        camera.now()
        capture.gone = True
        with pytest.raises(CameraError, match="no more frames"):
            camera.now()


def test_nothing_reads_the_camera_when_it_is_closed(camera: Camera) -> None:
    """OpenCV aborts a process that ends while a thread reads a stream."""
    before = set(threading.enumerate())
    with camera:
        camera.now()
        assert set(threading.enumerate()) != before
    assert set(threading.enumerate()) == before


@pytest.mark.parametrize("noiseless", [False, True])
def test_only_a_synthetic_camera_may_repeat_a_frame(capture: FakeCapture, noiseless: bool) -> None:
    image = capture.retrieve()
    capture.retrieve = lambda: image  # type: ignore[method-assign]
    keys = SETTINGS.model_copy(update={"noiseless": noiseless})
    with Camera(keys, lambda _: capture) as camera:
        if noiseless:
            assert len(camera.fresh(0, 3)) == 3
        else:
            with pytest.raises(CameraError, match="is frozen: it repeats frames"):
                camera.fresh(0, 3)


def test_crop(capture: FakeCapture) -> None:
    keys = SETTINGS.model_copy(update={"crop": (4, 2, 20, 10)})
    with Camera(keys, lambda _: capture) as camera:
        assert camera.now().image.shape == (10, 20)


def test_exposure_is_manual_and_read_back(capture: FakeCapture) -> None:
    keys = SETTINGS.model_copy(update={"exposure": 120.0, "gain": 3.0})
    actual = configure(capture, keys)
    assert (actual.auto_exposure, actual.exposure, actual.gain) == (1.0, 120.0, 3.0)


@pytest.mark.parametrize(
    ("refused", "keys", "message"),
    [
        (cv2.CAP_PROP_AUTO_EXPOSURE, {"exposure": 50.0}, "does not switch its automatic exposure"),
        (cv2.CAP_PROP_EXPOSURE, {"exposure": 50.0}, r"camera.exposure is 50.*stays at 0"),
        (cv2.CAP_PROP_GAIN, {"gain": 2.0}, r"camera.gain is 2"),
        (cv2.CAP_PROP_FRAME_WIDTH, {"size": (640, 480)}, r"640 x 480; name a size"),
        (cv2.CAP_PROP_FOURCC, {"fourcc": "MJPG"}, r"camera.fourcc asks for 'MJPG'"),
    ],
)
def test_a_setting_that_is_not_taken_is_refused(
    capture: FakeCapture, refused: int, keys: dict[str, Any], message: str
) -> None:
    capture.refused.add(refused)
    with pytest.raises(UserError, match=message):
        configure(capture, SETTINGS.model_copy(update=keys))


def test_a_camera_that_is_not_there() -> None:
    keys = CameraSettings(source="/dev/v4l/by-id/nothing")
    with pytest.raises(CameraError, match="v4l/by-id"):
        open_capture(keys)


class TestGate:
    keys = SensorSettings()

    def frames(self, change: float = 0.0, noise: float = 1.0, count: int = 3) -> list[CameraFrame]:
        capture = FakeCapture()
        rng = np.random.default_rng(1)
        image = capture.rest + change * capture.pattern
        return [
            CameraFrame(
                np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(
                    np.uint8
                ),
                k,
            )
            for k in range(count)
        ]

    @pytest.fixture
    def rest(self) -> Reference:
        return Reference.of(self.frames(count=20))

    def test_a_press_is_kept_as_the_median(self, rest: Reference) -> None:
        frames = self.frames(0.3)
        check = check_frames(frames, rest, self.keys, 2.0)
        assert check.reason == ""
        assert check.t_ns == 1
        assert np.array_equal(check.image, np.median([s.image for s in frames], axis=0))

    @pytest.mark.parametrize(
        ("spoil", "message"),
        [
            (lambda i, k: np.zeros_like(i), "brightness"),
            (lambda i, k: np.clip(i.astype(int) + 20, 0, 255), "brightness"),
            (lambda i, k: np.where(np.arange(48) < 1, 255, i), "saturated"),
            (lambda i, k: i + 3.0 * (k % 2), "still moves"),
        ],
    )
    def test_what_cannot_be_kept(
        self, rest: Reference, spoil: Callable[[Any, int], Any], message: str
    ) -> None:
        frames = [
            CameraFrame(spoil(s.image, k).astype(np.uint8), s.t_ns)
            for k, s in enumerate(self.frames(0.1))
        ]
        assert message in check_frames(frames, rest, self.keys, 2.0).reason

    def test_a_camera_that_repeats_itself(self, rest: Reference) -> None:
        frames = [CameraFrame(self.frames(0.3)[0].image, k) for k in range(3)]
        assert "repeats itself" in check_frames(frames, rest, self.keys, 2.0).reason

    def test_a_deep_press_that_nobody_sees(self, rest: Reference) -> None:
        assert "no contact is seen" in check_frames(self.frames(0.0), rest, self.keys, 2.0).reason
        assert check_frames(self.frames(0.0), rest, self.keys, 0.2).reason == ""

    def test_pins_are_counted(self, rest: Reference) -> None:
        keys = SensorSettings(pins=rest.pins)
        assert rest.pins == 36
        assert check_frames(self.frames(0.3), rest, keys, 2.0).reason == ""
        assert "pins" in check_frames(self.frames(0.3), rest, SensorSettings(pins=30), 2.0).reason

    def test_noise_is_not_a_touch_and_a_touch_is(self, rest: Reference) -> None:
        assert all(rest.change_of(s.image) < rest.threshold for s in self.frames(count=20))
        assert all(rest.change_of(s.image) > rest.threshold for s in self.frames(0.05))
