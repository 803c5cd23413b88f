"""The emulated controller says what real firmware (GRBL 1.1h) said, line by line."""

from __future__ import annotations

import re

import pytest
from grbl_bench import Bench

UNLIMITED = {"$20": 0, "$21": 0, "$22": 0, "$110": 1000, "$120": 10, "$112": 500, "$122": 10}
"""The firmware's defaults: no limits, no homing, 10 mm/s2."""
BANNER = ["", "Grbl 1.1h ['$' for help]"]
LOCKED = "[MSG:'$H'|'$X' to unlock]"


@pytest.fixture
def grbl() -> Bench:
    bench = Bench(UNLIMITED)
    assert bench.power_up() == BANNER
    return bench


def test_a_move_without_a_feed_is_error_22(grbl: Bench) -> None:
    assert grbl.say("G1 X10") == ["error:22"]


def test_ok_comes_before_the_motion_and_a_dwell_after_it(grbl: Bench) -> None:
    assert grbl.say("G1 X10 F600") == ["ok"]
    (status,) = grbl.after(0.613, b"?")
    assert status == "<Run|MPos:1.879,0.000,0.000|FS:368,0|WCO:0.000,0.000,0.000>"
    assert grbl.say("G4 P0.01") == []
    end = 2.0  # 10 mm at 10 mm/s2 reach 10 mm/s in the middle
    assert grbl.after(end - 0.02 - grbl.clock.t) == []
    assert grbl.after(0.06) == ["ok"]
    (status,) = grbl.send(b"?")
    assert status.startswith("<Idle|MPos:10.000,0.000,0.000|FS:0,0")


def test_a_jog_locks_out_g_code_and_is_cancelled_in_silence(grbl: Bench) -> None:
    assert grbl.say("$J=G91 X50 F600") == ["ok"]
    (status,) = grbl.after(1.2, b"?")
    assert status.startswith("<Jog|MPos:")
    assert grbl.say("G0 X0") == ["error:9"]
    assert grbl.send(b"\x85") == []
    assert grbl.after(2.0) == []
    (status,) = grbl.send(b"?")
    assert status.startswith("<Idle|MPos:12.0")  # 7 mm after 1.2 s, 5 mm to brake
    assert grbl.say("G0 X0") == ["ok"]


def test_a_probe_that_meets_nothing_is_alarm_5_and_still_ok(grbl: Bench) -> None:
    assert grbl.say("G38.2 Z-1 F300") == []
    assert grbl.after(5.0) == ["ALARM:5", "[PRB:0.000,0.000,0.000:0]", "ok"]
    (status,) = grbl.send(b"?")
    assert status.startswith("<Alarm|MPos:0.000,0.000,-1.000")
    assert grbl.say("G0 X0") == ["error:9"]
    assert grbl.say("$X") == ["[MSG:Caution: Unlocked]", "ok"]
    assert grbl.say("G0 Z0") == ["ok"]


def test_in_a_hold_lines_wait_for_the_cycle_start(grbl: Bench) -> None:
    grbl.say("G1 X10 F600")
    assert grbl.after(0.5, b"!") == []
    (braking,) = grbl.send(b"?")
    assert braking.startswith("<Hold:1|")
    assert grbl.send(b"~") == []  # while it brakes it does not resume
    (status,) = grbl.after(2.0, b"?")
    assert status.startswith("<Hold:0|MPos:2.500,0.000,0.000|FS:0,0")
    assert grbl.say("G0 X1") == []
    assert grbl.after(60.0) == []
    assert grbl.send(b"~") == ["ok"]
    (status,) = grbl.after(9.0, b"?")
    assert status.startswith("<Idle|MPos:1.000,")


def test_a_reset_in_a_hold_is_alarm_3(grbl: Bench) -> None:
    grbl.say("G1 X10 F600")
    grbl.after(0.5, b"!")
    assert grbl.after(2.0, b"\x18") == ["ALARM:3", *BANNER, LOCKED]
    (status,) = grbl.send(b"?")
    assert status.startswith("<Alarm|")


def test_a_reset_in_motion_is_alarm_3_and_loses_steps(grbl: Bench) -> None:
    grbl.say("G1 X10 F600")
    assert grbl.after(0.5, b"\x18") == ["ALARM:3", *BANNER, LOCKED]
    (status,) = grbl.send(b"?")
    counted = float(re.search(r"MPos:([-\d.]+)", status)[1])  # type: ignore[index]
    true = grbl.world.tool()[0] - grbl.start[0]
    assert true == pytest.approx(1.25)
    assert counted == pytest.approx(true + 5.0**2 / 20, abs=2e-3)
    assert grbl.say("$H") == ["error:5"]


def test_a_reset_at_rest_is_a_banner_only(grbl: Bench) -> None:
    assert grbl.send(b"\x18") == BANNER


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("G1 X" + "1" * 80, "error:11"),
        ("", "ok"),
        ("(a comment) ; and another", "ok"),
        ("M99", "error:20"),
        ("G2 X1 I1 F100", "error:20"),
        ("G0 X1 X2", "error:25"),
        ("G0 G1 X2", "error:21"),
        ("$20=1", "error:10"),
        ("$22=1", "ok"),
        ("$99=1", "error:3"),
        ("$110=x", "error:2"),
        ("$110=-4", "error:4"),
        ("$J=G91 X1", "error:22"),
        ("$J=G91 F100", "error:26"),
        ("$J=G1 X1 F100", "error:16"),
        ("$Q", "error:3"),
        ("1X", "error:1"),
        ("X", "error:2"),
        ("G38.2 F10", "error:26"),
        ("G38.2 X0 F10", "error:33"),
        ("G4", "error:28"),
        ("G10 L3 P1 X0", "error:29"),
        ("G80 X1", "error:31"),
        ("G0 X1 P2", "error:36"),
        ("g0 x 1", "ok"),
        ("F-1", "error:4"),
    ],
)
def test_what_a_line_is_answered(grbl: Bench, line: str, answer: str) -> None:
    assert grbl.say(line) == [answer]


def test_what_is_printed_on_request(grbl: Bench) -> None:
    version = grbl.say("$I")
    assert version[0].startswith("[VER:1.1h")
    assert version[-1] == "ok"
    assert grbl.say("$G") == ["[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]", "ok"]
    settings = grbl.say("$$")
    assert "$13=0" in settings
    assert "$110=1000.000" in settings
    assert [int(line[1:].split("=")[0]) for line in settings[:-1]] == sorted(
        int(line[1:].split("=")[0]) for line in settings[:-1]
    )
    assert grbl.say("$#")[-2:] == ["[PRB:0.000,0.000,0.000:0]", "ok"]


def test_offsets_come_in_some_reports_only(grbl: Bench) -> None:
    reports = [grbl.send(b"?")[0] for _ in range(21)]
    assert [k for k, line in enumerate(reports) if "WCO:" in line] == [0, 10, 20]
    assert sum("Ov:100,100,100" in line for line in reports) == 2
