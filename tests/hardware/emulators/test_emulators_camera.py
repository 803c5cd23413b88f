"""OpenCV reads the emulated camera."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from emulated import GraySensor

from tactibench import UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.camera import CameraEmulator, Picture
from tactibench_tactip.emulators.world import World

FPS = 100.0
DEADLINES = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 4000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 400]


@pytest.fixture
def world() -> World:
    return World(GraySensor())


@pytest.fixture
def camera(world: World) -> Iterator[CameraEmulator]:
    with CameraEmulator(world, fps=FPS, noise=0.0) as camera:
        yield camera


def open_capture(camera: CameraEmulator) -> Any:
    capture = cv2.VideoCapture(camera.url, cv2.CAP_FFMPEG, DEADLINES)
    assert capture.isOpened()
    return capture


def read_until(capture: Any, condition: Callable[[Any], bool], most: int = 60) -> None:
    for _ in range(most):
        good, frame = capture.read()
        assert good
        if condition(frame):
            return
    raise AssertionError("it never came")


@pytest.mark.long
class TestStream:
    def test_the_frame_is_the_sensors(self, world: World, camera: CameraEmulator) -> None:
        capture = open_capture(camera)
        _, frame = capture.read()
        assert np.array_equal(frame, np.stack([world.rest] * 3, axis=-1))
        assert not capture.set(cv2.CAP_PROP_EXPOSURE, -6)
        capture.release()

    def test_faults_show(self, world: World, camera: CameraEmulator) -> None:
        capture = open_capture(camera)
        world.arm(Fault("brightness-jump", value=60))
        read_until(capture, lambda f: f.max() > 130)
        world.arm(Fault("pin-loss", value=4))
        read_until(capture, lambda f: (f[..., 0] > 100).sum() == 5 * 16)
        camera.picture.repair()
        read_until(capture, lambda f: (f[..., 0] == 80).sum() == 9 * 16)
        world.arm(Fault("black-frames", value=0.1))
        read_until(capture, lambda f: f.max() < 10)
        read_until(capture, lambda f: f.max() == 80)
        world.arm(Fault("camera-stall"))
        while capture.read()[0]:
            pass
        assert [event.handled for event in world.fired] == [True] * 4
        capture.release()

    def test_dropped_it_can_be_opened_again(self, world: World, camera: CameraEmulator) -> None:
        capture = open_capture(camera)
        assert capture.read()[0]
        world.arm(Fault("camera-drop"))
        while capture.read()[0]:
            pass
        capture.release()
        again = open_capture(camera)
        assert again.read()[0]
        again.release()

    def test_a_client_that_does_not_read_finds_old_frames(
        self, world: World, camera: CameraEmulator
    ) -> None:
        capture = open_capture(camera)
        capture.read()
        time.sleep(0.3)
        world.arm(Fault("brightness-jump", value=100))
        old = 0
        while capture.read()[1].max() < 170:
            old += 1
        assert old >= 10
        capture.release()

    def test_nothing_stays_when_it_stops(self, world: World) -> None:
        before = set(threading.enumerate())
        with CameraEmulator(world, fps=FPS) as camera:
            captures = [open_capture(camera) for _ in range(3)]
            assert all(capture.read()[0] for capture in captures)
            url = camera.url
        assert set(threading.enumerate()) == before
        for capture in captures:
            capture.release()
        camera.start()
        assert camera.url == url
        camera.stop()


def test_stale_frames_are_those_of_before(world: World) -> None:
    camera = CameraEmulator(world, noise=0.0)
    world.arm(Fault("stale-frames", value=0.2))
    world.rest = np.full_like(world.rest, 200)  # something happens
    assert camera.frame().max() == 80
    while camera.frame().max() == 80:
        pass
    assert world.clock.now() >= 0.2
    assert camera.frame().max() == 200


def test_noise_is_that_of_a_small_camera_and_new_in_every_frame() -> None:
    level = 100
    picture = Picture(np.full((64, 64), level, np.uint8), 1.0, 0)
    frames = np.array([picture.frame(np.full((64, 64), level, np.uint8)) for _ in range(40)])
    expected = 1.5**2 + 255 / 10_000 * level + 1 / 12
    assert frames.var() == pytest.approx(expected, rel=0.05)
    assert frames.mean() == pytest.approx(level, abs=0.1)
    assert frames.var(axis=0).mean() == pytest.approx(expected, rel=0.15)


def test_a_sensor_of_colours_is_refused() -> None:
    class Colours(GraySensor):
        def rest(self) -> Any:
            frame = super().rest()
            return type(frame)(np.stack([frame.image] * 3, axis=-1), 0.0, frame.pose)

    with pytest.raises(UserError, match="gray frames"):
        CameraEmulator(World(Colours()))
