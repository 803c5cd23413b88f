"""The real ur_rtde client against emulated controllers, which run in a process of their own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from emulated import GraySensor

from tactibench import UserError
from tactibench_tactip.emulators import Apart, Envelope, Fault, Setup

REASON = "ur_rtde is not installed (it has no wheel for Python 3.13)"
rtde_control = pytest.importorskip("rtde_control", reason=REASON)
rtde_receive = pytest.importorskip("rtde_receive", reason=REASON)
dashboard_client = pytest.importorskip("dashboard_client", reason=REASON)

FIELDS = ["timestamp", "actual_TCP_pose", "actual_TCP_force", "safety_status_bits"]
HOST, LOCAL, FIELDBUS = "127.0.0.41", "127.0.0.42", "127.0.0.43"
BOX = Envelope(x=(-30, 30), y=(-30, 30), z=(-75, 6.5))


class Arm:
    def __init__(self, host: str) -> None:
        self.control = rtde_control.RTDEControlInterface(host)
        self.receive = rtde_receive.RTDEReceiveInterface(host, 125.0, FIELDS)
        self.home = self.receive.getActualTCPPose()

    def at(self, down_mm: float) -> list[float]:
        pose = list(self.home)
        pose[2] -= 1e-3 * down_mm
        return pose

    def close(self) -> None:
        self.control.disconnect()
        self.receive.disconnect()


@pytest.fixture(scope="module")
def world() -> Iterator[Apart]:
    with Apart(Setup(GraySensor(), envelope=BOX, time_scale=20.0, ur={"host": HOST})) as world:
        yield world


@pytest.fixture
def arm(world: Apart) -> Iterator[Arm]:
    arm = Arm(HOST)
    yield arm
    arm.control.reuploadScript() if not arm.control.isProgramRunning() else None
    eventually(arm.control.isProgramRunning)
    arm.control.moveL(arm.home, 0.25, 1.0)
    arm.close()
    assert not world.log.outside


def eventually(so: Callable[[], Any], seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not so():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.005)


def test_it_moves_and_says_where_it_is(world: Apart, arm: Arm) -> None:
    assert arm.control.moveL(arm.at(52.0), 0.05, 0.5)
    assert world.tool()[2] == pytest.approx(2.0, abs=1e-6)
    assert world.truth().depth_mm == pytest.approx(2.0, abs=1e-6)
    eventually(lambda: arm.receive.getActualTCPPose() == pytest.approx(arm.at(52.0), abs=1e-9))
    assert arm.receive.getActualTCPForce()[2] == pytest.approx(1.6, abs=1e-6)


def test_a_guarded_descent_is_stopped(world: Apart, arm: Arm) -> None:
    assert arm.control.moveL(arm.at(55.0), 0.002, 0.5, True)
    assert arm.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
    eventually(lambda: arm.receive.getActualTCPForce()[2] > 0.8, 10.0)
    arm.control.stopL(10.0)
    assert 1.0 < world.truth().depth_mm < 5.0
    eventually(lambda: not arm.control.getAsyncOperationProgressEx().isAsyncOperationRunning())


def test_a_protective_stop_is_unlocked_and_the_script_loaded_again(world: Apart, arm: Arm) -> None:
    world.arm(Fault("protective-stop", press=world.presses + 1, depth_mm=1.0))
    assert not arm.control.moveL(arm.at(53.0), 0.02, 0.5)
    eventually(lambda: arm.receive.getSafetyStatusBits() == 1 << 2 | 1 << 10)
    assert world.truth().depth_mm == pytest.approx(1.04, abs=1e-3)
    dashboard = dashboard_client.DashboardClient(HOST)
    dashboard.connect()
    assert dashboard.safetystatus() == "Safetystatus: PROTECTIVE_STOP"
    with pytest.raises(RuntimeError, match="until 5s after occurrence"):
        dashboard.unlockProtectiveStop()
    time.sleep(5.2 / 20)
    world.arm(Fault("unlock-refused", value=1))
    with pytest.raises(RuntimeError, match="until 5s after occurrence"):
        dashboard.unlockProtectiveStop()
    dashboard.unlockProtectiveStop()
    assert dashboard.safetystatus() == "Safetystatus: NORMAL"
    assert arm.control.reuploadScript()
    eventually(arm.control.isProgramRunning)
    assert arm.control.moveL(arm.at(10.0), 0.05, 0.5)
    dashboard.disconnect()


def test_the_watchdog_stops_the_program(world: Apart, arm: Arm) -> None:
    assert arm.control.setWatchdog(10.0)
    for _ in range(8):
        assert arm.control.kickWatchdog()
        time.sleep(0.02)
    assert arm.control.isProgramRunning()
    eventually(lambda: not arm.control.isProgramRunning())
    assert "watchdog" in world.messages()[-1]


def test_a_frozen_stream_goes_on_when_the_fault_is_over(world: Apart, arm: Arm) -> None:
    world.arm(Fault("frozen-stream", value=6.0))  # 0.3 s of the host
    time.sleep(0.05)
    first = arm.receive.getTimestamp()
    time.sleep(0.1)
    assert arm.receive.getTimestamp() == first
    eventually(lambda: arm.receive.getTimestamp() > first)


def test_two_control_clients_do_not_write_the_same_registers(arm: Arm) -> None:
    with pytest.raises(RuntimeError, match="already in use"):
        rtde_control.RTDEControlInterface(HOST)
    other_half = rtde_control.RTDEControlInterface.FLAG_UPPER_RANGE_REGISTERS
    flags = rtde_control.RTDEControlInterface.FLAG_UPLOAD_SCRIPT | other_half
    flags |= rtde_control.RTDEControlInterface.FLAG_NO_EXT_FT
    other = rtde_control.RTDEControlInterface(HOST, -1.0, flags)
    assert other.moveL(arm.at(10.0), 0.1, 0.5)
    other.stopScript()
    other.disconnect()
    eventually(lambda: not arm.control.isProgramRunning())


def test_a_robot_in_local_mode_and_registers_of_a_fieldbus_are_refused() -> None:
    with (
        Apart(Setup(GraySensor(), ur={"host": LOCAL, "remote": False})),
        Apart(Setup(GraySensor(), ur={"host": FIELDBUS, "in_use": ("input_int_register_0",)})),
    ):
        with pytest.raises(RuntimeError, match="remote control"):
            rtde_control.RTDEControlInterface(LOCAL)
        with pytest.raises(RuntimeError, match="already in use"):
            rtde_control.RTDEControlInterface(FIELDBUS)


def test_what_goes_wrong_apart_is_raised_here(world: Apart) -> None:
    with pytest.raises(UserError, match="no grbl among"):
        world.plug()
    with (
        pytest.raises(UserError, match="cannot be opened"),
        Apart(Setup(GraySensor(), ur={"host": HOST})),
    ):
        pass
