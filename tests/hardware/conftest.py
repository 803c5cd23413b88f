"""Fixtures around a robot and a camera that are not there."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator

import pytest
from fake_station import FakeCapture, FakeRobot, make_settings

from tactibench import Indenter, Pose, Scene
from tactibench_tactip import Camera, Settings


@pytest.fixture(autouse=True)
def any_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of fakes come as fast as the machine makes them, and none waits in a buffer."""
    monkeypatch.setattr("tactibench_tactip.camera.FILLED_S", 0.0)
    monkeypatch.setattr(Camera, "check_rate", lambda camera: camera._settings.fps)


@pytest.fixture
def settings() -> Settings:
    """Settings of a UR, with the camera as it is; pins are not counted."""
    return make_settings()


@pytest.fixture
def robot(settings: Settings) -> FakeRobot:
    return FakeRobot(settings)


@pytest.fixture
def capture(robot: FakeRobot) -> FakeCapture:
    return FakeCapture(robot)


@pytest.fixture
def camera(settings: Settings, capture: FakeCapture) -> Camera:
    def opened(_: object) -> FakeCapture:
        capture.opened += 1
        return capture

    return Camera(settings.camera, opened)


@pytest.fixture
def press_of() -> Callable[..., Scene]:
    def scene(x: float = 0.0, y: float = 0.0, depth: float = 2.0) -> Scene:
        return Scene(Indenter.single(), Pose(x, y, depth=depth))

    return scene


@pytest.fixture
def interruptible() -> Iterator[None]:
    """A process that was started in the background has SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)
