"""pyserial talks to the emulated GRBL controller over a pseudo-terminal and a socket."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from emulated import GraySensor
from grbl_bench import RIG

from tactibench import UserError
from tactibench_tactip.emulators import Envelope, Fault, GrblEmulator, World

serial = pytest.importorskip("serial", reason="pyserial is not installed")
LINKS = ["socket"] if sys.platform == "win32" else ["pty", "socket"]
SCALE = 50.0
DEADLINE_S = 5.0


class Client:
    def __init__(self, port: str) -> None:
        self.port = serial.serial_for_url(port, baudrate=115200, timeout=0.02, do_not_open=True)
        if not port.startswith("socket"):
            self.port.dtr = False
        self.port.open()

    def until(self, *ends: str, seconds: float = DEADLINE_S) -> list[str]:
        """Lines up to one that begins so."""
        found: list[str] = []
        data, end = b"", time.monotonic() + seconds
        while time.monotonic() < end:
            data += self.port.read(4096)
            *whole, rest = data.split(b"\r\n")
            found += [line.decode("latin-1") for line in whole]
            data = rest
            if any(line.startswith(ends) for line in found):
                return found
        raise AssertionError(f"no {ends} in {found}")

    def poll(self) -> None:
        for _ in range(100):
            self.port.read(10)
            self.port.write(b"?")

    def say(self, line: str, *ends: str) -> list[str]:
        self.port.write(line.encode() + b"\n")
        return self.until(*(ends or ("ok", "error")))

    def home(self) -> None:
        self.until("[MSG:'$H'|'$X' to unlock]")
        assert self.say("$H") == ["ok"]


@pytest.fixture(params=LINKS)
def stage(request: pytest.FixtureRequest) -> Iterator[tuple[World, GrblEmulator]]:
    with (
        World(GraySensor(), RIG, time_scale=SCALE) as world,
        GrblEmulator(world, link=request.param) as grbl,
    ):
        yield world, grbl


def opened(grbl: GrblEmulator) -> Any:
    client = Client(grbl.port)
    client.home()
    return client


def test_a_press_and_back(stage: tuple[World, GrblEmulator]) -> None:
    world, grbl = stage
    client = opened(grbl)
    world.keep_to(Envelope(x=(-120, 120), y=(-120, 120), z=(-100, 3.5)))
    for line in ("G53 G0 X-100 Y-100 Z-70", "G1 Z-83 F300", "G4 P0.01"):
        assert client.say(line) == ["ok"]
    assert world.truth().depth_mm == pytest.approx(3.0, abs=5e-3)
    client.port.write(b"?")
    assert client.until("<")[0].startswith("<Idle|MPos:-100.000,-100.000,-83.000")
    client.say("G0 Z-70")
    client.say("G4 P0.01")
    assert world.presses == 1
    assert world.log.presses[0].deepest_mm == pytest.approx(3.0, abs=5e-3)
    assert not world.log.outside
    client.port.close()


def test_opening_the_port_again_is_a_reset(stage: tuple[World, GrblEmulator]) -> None:
    _, grbl = stage
    opened(grbl).port.close()
    time.sleep(0.1)
    again = Client(grbl.port)
    assert "Grbl 1.1h ['$' for help]" in again.until("[MSG:")
    assert again.say("G0 X1") == ["error:9"]
    again.port.close()


def test_unplugged_it_is_gone_and_plugged_in_it_is_back(stage: tuple[World, GrblEmulator]) -> None:
    world, grbl = stage
    name = grbl.port
    client = opened(grbl)
    client.say("G53 G1 X-100 F600")
    world.arm(Fault("unplug"))
    with pytest.raises(serial.SerialException):
        client.poll()
    client.port.close()
    z = world.tool()
    assert world.tool() == z  # without power it stands still
    grbl.plug()
    assert grbl.port == name
    again = opened(grbl)
    assert again.say("$G")[-1] == "ok"
    again.port.close()


@pytest.mark.parametrize("kind", ["no-ok", "garbled-line", "alarm-1", "alarm-3", "hold"])
def test_faults_reach_the_client(kind: str) -> None:
    fault = Fault(kind, press=1, depth_mm=1.0)
    with (
        World(GraySensor(), RIG, time_scale=SCALE, faults=(fault,)) as world,
        GrblEmulator(world) as grbl,
    ):
        client = opened(grbl)
        client.say("G53 G0 X-100 Y-100 Z-70")
        client.say("G1 Z-83 F300")
        client.port.write(b"G4 P0.01\n")
        if kind == "no-ok":
            with pytest.raises(AssertionError, match=r"no \('ok',\) in \[\]"):
                client.until("ok", seconds=0.5)
        elif kind == "garbled-line":
            assert client.until("\xff") == ["\xffk\x00"]
        elif kind == "hold":
            time.sleep(0.1)
            client.port.write(b"?")
            assert client.until("<")[0].startswith("<Hold:0|MPos:-100.000,-100.000,-81.0")
            client.port.write(b"~")
            assert client.until("ok") == ["ok"]
        else:
            assert client.until("ALARM")[0] == f"ALARM:{kind[-1]}"
            assert world.truth().depth_mm == pytest.approx(1.0, abs=2e-3)
        assert [(f.fault.kind, f.taken) for f in world.fired] == [(kind, True)]
        client.port.close()


def test_a_second_client_on_a_terminal_is_refused() -> None:
    with World(GraySensor(), RIG, time_scale=SCALE) as world, GrblEmulator(world) as grbl:
        first = serial.Serial(grbl.port, exclusive=True)
        with pytest.raises(serial.SerialException):
            serial.Serial(grbl.port, exclusive=True)
        first.close()


def test_several_at_once_and_nothing_stays() -> None:
    before = set(threading.enumerate())
    worlds = [World(GraySensor(), RIG, time_scale=SCALE) for _ in range(3)]
    stages = [GrblEmulator(world, link=LINKS[0]) for world in worlds]
    for stage in stages:
        stage.start()
    clients = [Client(stage.port) for stage in stages]
    for k, client in enumerate(clients):
        client.home()
        client.say(f"G53 G0 Z-{10 + k}")
        client.say("G4 P0.01")
    heights = [world.tool()[2] for world in worlds]
    assert heights == pytest.approx([-70.0, -69.0, -68.0], abs=5e-3)
    for client in clients:
        client.port.close()
    for stage in stages:
        stage.stop()
        stage.stop()
    assert set(threading.enumerate()) == before
    assert not any(Path(stage.port).parent.exists() for stage in stages if LINKS[0] == "pty")


def test_a_link_that_there_is_not_is_refused() -> None:
    with pytest.raises(UserError, match="the link is 'usb'; it must be 'pty' or 'socket'"):
        GrblEmulator(World(GraySensor(), RIG), link="usb")
