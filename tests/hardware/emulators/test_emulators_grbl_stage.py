"""The emulated stage: homing, limits, probing, look-ahead, faults."""

from __future__ import annotations

import math

import numpy as np
import pytest
from grbl_bench import Bench

from tactibench import UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.grbl.settings import Settings

FREE = {"$20": 0, "$21": 0, "$22": 0}
LOCKED = "[MSG:'$H'|'$X' to unlock]"


def homed(**given: float) -> Bench:
    bench = Bench({f"${key}": value for key, value in given.items()})
    assert bench.power_up()[-1] == LOCKED
    assert bench.say("$H") == []
    assert bench.send(b"?") == []  # no report while it homes
    assert bench.after(60.0) == ["ok"]
    return bench


def test_homing_finds_the_machines_zero() -> None:
    bench = homed()
    assert bench.status()["state"] == "Idle"
    assert bench.place() == (-1.0, -1.0, -1.0)
    tool = bench.world.tool()  # of the work frame, turned about x at -100, -100, -80
    assert tool[:3] == pytest.approx((99.0, -99.0, -79.0))


def test_after_homing_the_work_frame_is_where_the_rig_says() -> None:
    bench = homed()
    bench.say("G53 G0 X-100 Y-100 Z-82")
    bench.after(20.0)
    assert bench.world.tool()[:3] == pytest.approx((0.0, 0.0, 2.0), abs=5e-3)
    assert bench.world.truth().depth_mm == pytest.approx(2.0, abs=5e-3)


def test_power_up_forgets_where_it_is() -> None:
    bench = homed()
    bench.power_up()
    assert bench.place() == (0.0, 0.0, 0.0)
    assert bench.status()["state"] == "Alarm"
    assert bench.say("G0 X1") == ["error:9"]


def test_a_soft_limit_brakes_and_waits_for_a_reset() -> None:
    bench = homed()
    bench.say("G0 X-150")
    assert bench.after(0.5) == []
    assert bench.say("G0 X5") == []
    assert bench.after(2.0) == ["ALARM:2", "[MSG:Reset to continue]"]
    assert bench.send(b"?") == []
    assert bench.say("$X") == []
    assert bench.send(b"\x18")[-1] == LOCKED
    assert bench.say("$X")[-1] == "ok"
    x = bench.place()[0]
    tool = bench.world.tool()  # the position is kept
    assert tool[0] == pytest.approx(x + 100, abs=2e-3)


def test_a_jog_beyond_the_travel_is_refused_without_an_alarm() -> None:
    bench = homed()
    assert bench.say("$J=G91 X50 F600") == ["error:15"]
    assert bench.status()["state"] == "Idle"


def above_the_dome(**given: float) -> Bench:
    bench = homed(**given)
    bench.say("G53 G0 X-100 Y-100 Z-70")
    bench.after(20.0)
    return bench


def test_a_probe_finds_the_surface_where_it_is() -> None:
    bench = above_the_dome()
    assert bench.say("G38.2 Z-90 F300") == []
    lines = bench.after(9.0)
    assert lines[-1] == "ok"
    assert lines[0] == "[PRB:-100.000,-100.000,-80.000:1]"
    braking = 5.0**2 / (2 * 500)
    assert bench.world.truth().depth_mm == pytest.approx(braking, abs=5e-3)
    assert "Pn" in bench.status()
    assert bench.say("G38.2 Z-90 F300") == ["ALARM:4", "ok"]


def test_a_broken_probe_circuit_meets_nothing() -> None:
    bench = above_the_dome()
    bench.grbl.blind = True
    bench.say("G38.2 Z-83 F300")
    assert bench.after(9.0)[0] == "ALARM:5"
    assert bench.world.truth().depth_mm == pytest.approx(3.0, abs=5e-3)
    bench.say("$X")
    bench.say("G0 Z-70")
    bench.after(9.0)
    bench.say("G38.3 Z-71 F300")
    assert bench.after(9.0) == ["[PRB:0.000,0.000,0.000:0]", "ok"]


def free(**given: float) -> Bench:
    bench = Bench({**FREE, **{f"${key}": value for key, value in given.items()}})
    bench.power_up()
    return bench


def test_straight_on_it_does_not_slow_down_and_at_a_corner_it_does() -> None:
    """Junction speed of a right angle: sqrt(a d s / (1 - s)), s = sin 45 deg, over both axes."""
    bench = free()
    bench.say("G1 X10 F1200")
    bench.say("G1 X20")
    bench.say("G1 Y20")
    t = bench.clock.t
    speed = bench.grbl.stage.speed
    slowest = min(speed(t + x) for x in np.linspace(0.1, 0.9, 400))
    assert slowest == pytest.approx(20.0)
    half = math.sin(math.radians(45))
    corner = math.sqrt(500 * math.sqrt(2) * 0.01 * half / (1 - half))
    times = np.linspace(0.9, 1.2, 4000)
    assert min(speed(t + x) for x in times) == pytest.approx(corner, rel=0.02)
    bench.after(4.0)
    assert bench.place() == (20.0, 20.0, 0.0)


def test_a_hold_in_the_middle_of_three_blocks_goes_on_to_the_same_end() -> None:
    bench = free()
    for line in ("G1 X3 F3000", "G1 X6", "G1 X6 Y4"):
        assert bench.say(line) == ["ok"]
    bench.after(0.08, b"!")
    bench.after(1.0)
    assert bench.status()["state"] == "Hold:0"
    held = bench.place()
    bench.after(5.0)
    assert bench.place() == held
    bench.send(b"~")
    bench.after(2.0)
    assert bench.place() == (6.0, 4.0, 0.0)


def test_no_block_is_left_no_line_is_answered() -> None:
    bench = free()
    answers = [bench.say(f"G1 X{k + 1} F60") for k in range(17)]
    assert answers[:15] == [["ok"]] * 15
    assert answers[15:] == [[], []]
    assert bench.after(1.5) == ["ok"]
    assert bench.after(30.0) == ["ok"]
    assert bench.place() == (17.0, 0.0, 0.0)


def test_the_receive_buffer_loses_what_is_too_much() -> None:
    bench = free()
    bench.say("G1 X10 F600")
    bench.after(0.2, b"!")
    bench.send(b"G0 X1 Y1 Z1\n" * 20)  # 240 bytes into 128
    assert bench.after(2.0, b"~") == ["ok"] * (128 // 12)


def test_a_line_may_come_in_any_portions_with_realtime_bytes_between() -> None:
    bench = free()
    assert bench.send(b"G1 X") == []
    (status,) = bench.send(b"?")
    assert status.startswith("<Idle|")
    assert bench.send(b"5 F60?0\r") == [
        "<Idle|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>",
        "ok",
    ]
    bench.after(3.0)
    assert bench.place() == (5.0, 0.0, 0.0)


def test_overrides_change_the_speed_at_once() -> None:
    bench = free()
    bench.say("G1 X100 F600")
    bench.after(1.0, b"\x91\x91")
    bench.after(0.1)
    assert bench.status()["FS"] == "720,0"
    bench.send(b"\x90")
    bench.after(0.1)
    assert bench.status()["FS"] == "600,0"
    for _ in range(30):
        bench.send(b"\x92")
    bench.after(0.1)
    assert bench.status()["FS"] == "60,0"


def test_units_offsets_and_relative_moves() -> None:
    bench = free()
    bench.say("G91 G20 G0 X1")
    bench.after(9.0)
    assert bench.place() == (25.4, 0.0, 0.0)
    bench.say("G21 G90 G10 L20 P1 X0")
    bench.say("G0 X2")
    bench.after(9.0)
    assert bench.place() == (27.4, 0.0, 0.0)
    bench.say("G92 X50")
    bench.say("G0 X51")
    bench.after(9.0)
    assert bench.place() == (28.4, 0.0, 0.0)
    bench.say("G92.1")
    bench.say("G53 G0 X1")
    bench.after(9.0)
    assert bench.place() == (1.0, 0.0, 0.0)


def test_rapids_go_as_fast_as_the_axes_may() -> None:
    bench = free(**{"110": 600.0, "111": 1200.0})
    bench.say("G0 X30 Y30")
    bench.after(1.0)
    assert bench.status()["FS"] == f"{math.floor(600 * math.sqrt(2) + 0.5)},0"


@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_alarm_in_a_press(number: int) -> None:
    fault = Fault(f"alarm-{number}", press=1, depth_mm=1.0)
    bench = Bench(FREE, faults=(fault,))
    said = {
        1: lambda t: bench.grbl.lose(1),
        2: lambda t: (bench.grbl.planner.halt(t), bench.grbl.alarm(2)),
        3: lambda t: (bench.grbl.lose(3), bench.grbl.reset()),
    }
    bench.world.answer([fault.kind], lambda f, t: (bench.grbl.at(t), said[number](t)))
    bench.power_up()
    bench.say("G1 Z-55 F600")
    lines = bench.after(9.0)
    assert lines[0] == f"ALARM:{number}"
    assert bench.world.truth().depth_mm == pytest.approx(1.0, abs=1e-3)
    assert lines[-1] == ("[MSG:Reset to continue]" if number < 3 else LOCKED)


def test_settings_that_do_not_exist_are_refused() -> None:
    with pytest.raises(UserError, match=r"no setting '\$7'; known are \$0, \$1"):
        Settings({"$7": 1.0})
