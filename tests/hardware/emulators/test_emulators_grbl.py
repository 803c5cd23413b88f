"""The emulated stage says what real firmware (GRBL 1.1h) said, and moves as it would."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from emulated import STAGE_RIG, GraySensor, Stage

from tactibench import UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.grbl import GrblEmulator
from tactibench_tactip.emulators.world import Clock, World

FIRMWARE = {"$20": 0, "$21": 0, "$22": 0, "$110": 1000, "$120": 10, "$112": 500, "$122": 10}
"""The firmware's own defaults: no limits, no homing, 10 mm/s2."""
BANNER = ["", "Grbl 1.1h ['$' for help]"]
LOCKED = "[MSG:'$H'|'$X' to unlock]"


@pytest.fixture
def grbl() -> Stage:
    stage = Stage(FIRMWARE)
    assert stage.power_up() == BANNER
    return stage


@pytest.fixture
def homed() -> Stage:
    stage = Stage()
    assert stage.power_up()[-1] == LOCKED
    assert stage.say("$H") == []
    assert stage.send(b"?") == []  # no report while it homes
    assert stage.after(60.0) == ["ok"]
    return stage


@pytest.fixture
def above_the_dome(homed: Stage) -> Stage:
    homed.say("$J=G53 X-100 Y-100 Z-78 F3000")
    homed.after(20.0)
    return homed


class TestTranscripts:
    def test_ok_comes_before_the_motion(self, grbl: Stage) -> None:
        assert grbl.say("$J=G91 X10 F600") == ["ok"]
        (status,) = grbl.after(0.613, b"?")
        assert status == "<Jog|MPos:1.879,0.000,0.000|FS:368,0|WCO:0.000,0.000,0.000>"
        (status,) = grbl.after(1.5, b"?")  # 10 mm at 10 mm/s2 take 2 s
        assert status == "<Idle|MPos:10.000,0.000,0.000|FS:0,0>"

    def test_a_jog_locks_out_g_code_and_is_cancelled_in_silence(self, grbl: Stage) -> None:
        assert grbl.say("$J=G91 X50 F600") == ["ok"]
        assert grbl.after(1.2) == []
        assert grbl.say("G90") == ["error:9"]
        assert grbl.send(b"\x85") == []
        (status,) = grbl.after(2.0, b"?")
        assert status.startswith("<Idle|MPos:12.0")  # 7 mm after 1.2 s, 5 mm to brake
        assert grbl.say("G90") == ["ok"]

    def test_a_second_jog_waits_for_the_first_and_is_cancelled_with_it(self, grbl: Stage) -> None:
        grbl.say("$J=G91 X10 F600")
        assert grbl.say("$J=G91 X10 F600") == []
        assert grbl.after(2.1) == ["ok"]
        grbl.after(2.0)
        assert grbl.place() == (20.0, 0.0, 0.0)
        grbl.say("$J=G91 X10 F600")
        grbl.say("$J=G91 X10 F600")
        assert grbl.after(0.1, b"\x85") == ["ok"]
        grbl.after(5.0)
        assert grbl.place()[0] < 21.0

    def test_a_probe_that_meets_nothing(self, grbl: Stage) -> None:
        assert grbl.say("G21G91G38.3 Z-1 F300") == []
        assert grbl.after(5.0) == ["[PRB:0.000,0.000,0.000:0]", "ok"]
        assert grbl.status()["state"] == "Idle"

    def test_in_a_hold_nothing_is_answered_and_a_reset_is_alarm_3(self, grbl: Stage) -> None:
        grbl.say("G91G38.3 X10 F600")
        assert grbl.after(0.5, b"!") == []
        assert grbl.status()["state"] == "Hold:1"
        (status,) = grbl.after(2.0, b"?")
        assert status.startswith("<Hold:0|MPos:2.500,0.000,0.000|FS:0,0")
        assert grbl.say("G90") == []
        assert grbl.after(60.0) == []
        assert grbl.send(b"\x18") == ["ALARM:3", *BANNER, LOCKED]
        assert grbl.status()["state"] == "Alarm"

    def test_a_reset_in_motion_is_alarm_3_and_loses_steps(self, grbl: Stage) -> None:
        start = grbl.world.tool()[0]
        grbl.say("$J=G91 X10 F600")
        assert grbl.after(0.5, b"\x18") == ["ALARM:3", *BANNER, LOCKED]
        true = grbl.world.tool()[0] - start
        assert true == pytest.approx(1.25)
        assert grbl.place()[0] == pytest.approx(true + 5.0**2 / 20, abs=2e-3)
        assert grbl.say("$H") == ["error:5"]

    def test_a_reset_at_rest_is_a_banner_only(self, grbl: Stage) -> None:
        assert grbl.send(b"\x18") == BANNER

    @pytest.mark.parametrize(
        ("line", "answer"),
        [
            ("", "ok"),
            ("G90", "ok"),
            ("M99", "error:20"),
            ("G2 X1 I1 F100", "error:20"),
            ("G0 X1", "error:20"),
            ("$J=G91 X1 X2 F10", "error:20"),
            ("$99=1", "error:3"),
            ("$Q", "error:3"),
            ("$J=G91 X1", "error:20"),
            ("$J=G91 F100", "error:20"),
            ("$J=G1 X1 F100", "error:20"),
            ("1X", "error:20"),
            ("X", "error:20"),
            ("G38.3 F10", "error:20"),
            ("G91G38.3 X1", "error:20"),
            ("$j=g91 x 1 f100", "ok"),
        ],
    )
    def test_what_a_line_is_answered(self, grbl: Stage, line: str, answer: str) -> None:
        assert grbl.say(line) == [answer]

    def test_what_is_printed_on_request(self, grbl: Stage) -> None:
        assert grbl.say("$I") == ["[VER:1.1h.20190830:]", "[OPT:V,15,128]", "ok"]
        lines = grbl.say("$$")
        assert {"$13=0", "$20=0", "$110=1000.000"} < set(lines)
        numbers = [int(line[1:].split("=")[0]) for line in lines[:-1]]
        assert numbers == sorted(numbers)
        reports = [grbl.send(b"?")[0] for _ in range(21)]
        assert [k for k, line in enumerate(reports) if "WCO:" in line] == [0, 10, 20]

    def test_a_line_may_come_in_any_portions_with_realtime_bytes_between(self, grbl: Stage) -> None:
        assert grbl.send(b"$J=G91 X") == []
        assert grbl.send(b"5 F60?0\n")[0].startswith("<Idle|")
        grbl.after(3.0)
        assert grbl.place() == (5.0, 0.0, 0.0)


class TestStage:
    def test_homing_finds_the_machines_zero(self, homed: Stage) -> None:
        assert homed.status()["state"] == "Idle"
        assert homed.place() == (-1.0, -1.0, -1.0)
        tool = homed.world.tool()  # of the work frame, turned about x at -100, -100, -80
        assert tool[:3] == pytest.approx((99.0, -99.0, -79.0))
        homed.say("$J=G53 X-100 Y-100 Z-82 F3000")
        homed.after(20.0)
        assert homed.world.tool()[:3] == pytest.approx((0.0, 0.0, 2.0), abs=5e-3)
        homed.power_up()
        assert homed.place() == (0.0, 0.0, 0.0)
        assert homed.say("$J=G91 X-1 F100") == ["error:8"]

    def test_a_jog_beyond_the_travel_is_refused_without_an_alarm(self, homed: Stage) -> None:
        assert homed.say("$J=G91 X50 F600") == ["error:15"]
        assert homed.status()["state"] == "Idle"

    def test_a_probe_finds_the_surface_where_it_is(self, above_the_dome: Stage) -> None:
        stage = above_the_dome
        assert stage.say("G91G38.3 Z-9 F300") == []
        lines = stage.after(9.0)
        assert lines == ["[PRB:-100.000,-100.000,-80.000:1]", "ok"]
        braking = 5.0**2 / (2 * 500)
        assert stage.world.truth().depth_mm == pytest.approx(braking, abs=5e-3)
        assert "Pn" in stage.status()
        assert stage.say("G91G38.3 Z-1 F300") == ["ALARM:4", "ok"]

    def test_a_broken_probe_circuit_meets_nothing(self, above_the_dome: Stage) -> None:
        stage = above_the_dome
        stage.grbl.blind = 1
        stage.say("G91G38.3 Z-5 F300")
        assert stage.after(9.0) == ["[PRB:0.000,0.000,0.000:0]", "ok"]
        assert stage.world.truth().depth_mm == pytest.approx(3.0, abs=5e-3)

    def test_rates_are_those_of_the_axes(self) -> None:
        stage = Stage({**FIRMWARE, "$110": 600, "$120": 500, "$121": 500})
        stage.power_up()
        stage.say("$J=G91 X30 Y30 F9000")
        stage.after(1.0)
        assert stage.status()["FS"] == "849,0"  # 600 sqrt(2) mm/min

    def test_settings_that_do_not_exist_are_refused(self) -> None:
        with pytest.raises(UserError, match=r"no setting '\$7'; it has \$13, \$20"):
            Stage({"$7": 1.0})


class Client:
    """pyserial at the other end."""

    def __init__(self, port: str) -> None:
        import serial

        self.port: Any = serial.serial_for_url(port, baudrate=115200, timeout=0.02)

    def until(self, *ends: str, seconds: float = 5.0) -> list[str]:
        """Lines up to one that begins so."""
        data, end = b"", time.monotonic() + seconds
        while time.monotonic() < end:
            data += self.port.read(4096)
            lines = [line.decode("latin-1") for line in data.split(b"\r\n")[:-1]]
            if any(line.startswith(ends) for line in lines):
                return lines
        raise AssertionError(f"no {ends} in {data!r}")

    def say(self, line: str, *ends: str) -> list[str]:
        self.port.write(line.encode() + b"\n")
        return self.until(*(ends or ("ok", "error")))

    def reply(self, line: str) -> bytes:
        """Return the bytes that come within a moment."""
        self.port.write(line.encode() + b"\n")
        time.sleep(0.2)
        return bytes(self.port.read(4096))

    def home(self) -> None:
        self.until(LOCKED)
        assert self.say("$H") == ["ok"]

    def jog(self, message: str) -> None:
        """And wait until it stands."""
        assert self.say(f"$J={message} F3000") == ["ok"]
        for _ in range(500):
            if self.status().startswith("<Idle"):
                return
        raise AssertionError("it never stood still")

    def status(self) -> str:
        self.port.write(b"?")
        return next(line for line in self.until("<") if line.startswith("<"))

    def poll(self) -> None:
        for _ in range(100):
            self.port.read(10)
            self.port.write(b"?")


@pytest.mark.long
class TestSocket:
    @pytest.fixture(autouse=True)
    def _needs_pyserial(self) -> None:
        pytest.importorskip("serial", reason="pyserial is not installed")

    @pytest.fixture
    def served(self) -> Iterator[tuple[World, GrblEmulator]]:
        world = World(GraySensor(), STAGE_RIG, clock=Clock(50.0))
        with GrblEmulator(world) as grbl:
            yield world, grbl

    @pytest.fixture
    def client(self, served: tuple[World, GrblEmulator]) -> Iterator[Client]:
        client = Client(served[1].port)
        client.home()
        yield client
        client.port.close()

    def test_a_press_opening_again_and_plugging_in_again(
        self, served: tuple[World, GrblEmulator], client: Client
    ) -> None:
        import serial

        world, grbl = served
        client.jog("G53 X-100 Y-100 Z-70")
        client.jog("G53 Z-83")
        assert world.truth().depth_mm == pytest.approx(3.0, abs=5e-3)
        client.jog("G53 Z-70")
        assert world.presses == 1
        client.port.close()
        again = Client(grbl.port)
        again.home()
        name = grbl.port
        again.say("$J=G53 X-150 F60")
        world.arm(Fault("unplug"))
        with pytest.raises(serial.SerialException):
            again.poll()
        again.port.close()
        tool = world.tool()
        assert world.tool() == tool  # without power it stands still
        grbl.plug()
        assert grbl.port == name
        last = Client(name)
        last.home()
        last.port.close()

    @pytest.mark.parametrize(
        ("kind", "check"),
        [
            ("garbled-line", lambda c, _: c.say("G90", "\xff") == ["\xffk\x00"]),
            ("no-ok", lambda c, _: not c.reply("G90")),
            ("hold", lambda c, _: c.status().startswith("<Hold")),
            ("alarm-1", lambda c, w: _alarm(c, w, 1)),
            ("alarm-2", lambda c, w: _alarm(c, w, 2)),
            ("alarm-3", lambda c, w: _alarm(c, w, 3)),
        ],
    )
    def test_faults_reach_the_client(
        self,
        served: tuple[World, GrblEmulator],
        client: Client,
        kind: str,
        check: Callable[[Client, World], bool],
    ) -> None:
        world, _ = served
        client.jog("G53 X-100 Y-100 Z-70")
        if kind.startswith("alarm"):
            world.arm(Fault(kind, press=1, depth_mm=1.0))
            client.say("$J=G53 Z-83 F300")
        else:
            world.arm(Fault(kind))
        assert check(client, world)
        assert [(f.fault.kind, f.handled) for f in world.fired] == [(kind, True)]


def _alarm(client: Client, world: World, number: int) -> bool:
    lines = client.until("ALARM")
    depth = world.truth().depth_mm
    return bool(re.match(rf"ALARM:{number}$", lines[0])) and abs(depth - 1.0) < 2e-3
