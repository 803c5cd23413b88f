"""The shared world on a clock that is set by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from emulated import GraySensor, HandClock
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, UserError
from tactibench_tactip.emulators import Fault, world
from tactibench_tactip.emulators.motion import Move, Pose6, matrix
from tactibench_tactip.emulators.touch import Rig
from tactibench_tactip.emulators.watch import Envelope, Watch
from tactibench_tactip.emulators.world import Clock, World, simulated

SPEED, RATE = 20.0, 500.0


def make_world(**given: Any) -> tuple[World, HandClock]:
    clock = HandClock()
    return World(GraySensor(), clock=clock, **given), clock


def go(tool: World, *poses: Pose6, speed: float = SPEED) -> float:
    """Plan moves through poses of the work frame; returns when they end."""
    t = tool.advance()
    here, moves, begin = tool.pose_at(t), [], t
    for pose in poses:
        moves.append(Move.travel(begin, here, matrix(pose), speed, RATE))
        begin, here = moves[-1].end_s, moves[-1].end
    tool.follow(t, *moves)
    return tool.still_s


def down(x: float, z: float) -> Pose6:
    return (x, 0.0, z, 0.0, 0.0, 0.0)


def press(tool: World, clock: HandClock, depth: float, steps: int = 7) -> None:
    start, end = clock.t, go(tool, down(0, -2), down(0, depth), down(0, -5))
    for k in range(steps):
        clock.t = start + (end - start) * (k + 1) / steps
        tool.advance()


def test_the_tool_is_where_the_profile_says() -> None:
    tool, clock = make_world()
    end = go(tool, down(0, -10))
    assert end == pytest.approx(40 / SPEED + SPEED / RATE)
    clock.t = 1.0
    assert tool.tool()[2] == pytest.approx(-50 + SPEED * (1.0 - SPEED / RATE / 2))
    assert tool.brake(1.0, 100.0) == pytest.approx(1.2)
    clock.t = 3.0
    assert tool.tool()[2] == pytest.approx(-50 + SPEED * 0.98 + 2.0)
    go(tool, down(0, -20))
    clock.t = 3.1
    tool.follow(tool.advance())
    stopped = tool.tool()
    clock.t = 9.0
    assert tool.tool() == stopped


def test_truth_tells_depth_and_force_now_and_before() -> None:
    tool, clock = make_world()
    end = go(tool, down(0, 3), down(0, -5))
    clock.t = end + 1
    touched = int(1e9 * ((50 + 3) / SPEED + SPEED / RATE))
    assert tool.truth(touched).depth_mm == pytest.approx(3.0, abs=1e-3)
    assert tool.truth(touched).force_n == pytest.approx(2.4, abs=1e-3)
    assert tool.truth().scene is None
    assert tool.truth(int((end + 99) * 1e9)).tool == tool.tool()


def test_a_moment_that_is_not_kept_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world, "MOVES", 40)
    tool, clock = make_world()
    for k in range(60):
        go(tool, down(0, -30 - k % 2))
        clock.t += 0.01
    clock.t += 9.0
    assert tool.truth(int((clock.t - 1) * 1e9)).tool == tool.tool()
    with pytest.raises(ValueError, match="no longer kept"):
        tool.truth(int(0.05e9))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.05, 4.0), min_size=1, max_size=8), st.integers(1, 40))
def test_a_press_is_counted_once_however_often_somebody_looks(
    depths: Sequence[float], steps: int
) -> None:
    tool, clock = make_world()
    for depth in depths:
        press(tool, clock, depth, steps)
    assert tool.presses == sum(depth > world.PRESS_DEPTH_MM for depth in depths)


@settings(max_examples=30, deadline=None)
@given(st.floats(-19, 19), st.floats(0, 40), st.floats(-4, 4), st.integers(1, 9))
def test_every_time_outside_the_envelope_is_seen_however_rarely_one_looks(
    x: float, over: float, back: float, steps: int
) -> None:
    box = Envelope(x=(-20, 20), y=(-20, 20), z=(-60, 6.5))
    tool, clock = make_world()
    tool.keep_to(box)
    end = go(tool, down(x, -20), (x + over, back, -20.0, 0, 0, 0), down(0, -20), speed=300)
    for k in range(steps):
        clock.t = end * (k + 1) / steps
        tool.advance()
    outside = x + over > 20 + box.slack_mm
    assert len(tool.excursions) == outside
    assert not outside or tool.excursions[0][1][0] > 20


def test_the_envelope_holds_places_and_tilts_and_can_begin_later() -> None:
    box = Envelope(x=(-1, 1), y=(-2, 2), z=(-3, 3), tilt=20.0)
    poses = {
        (1, 2, 3, 0, 0, 170): True,
        (-1, -2, -3, 19.9, 0, 0): True,
        (1.1, 0, 0, 0, 0, 0): False,
        (0, -2.1, 0, 0, 0, 0): False,
        (0, 0, 3.1, 0, 0, 0): False,
        (0, 0, 0, 0, 20.1, 0): False,
        (0, 0, 0, 180, 0, 0): False,
    }
    assert box.holds(np.array([matrix(pose) for pose in poses])).tolist() == list(poses.values())
    tool, clock = make_world()
    clock.t = go(tool, down(60, -20), down(0, -20))
    tool.keep_to(Envelope(tilt=31.0))
    clock.t = go(tool, down(10, -20))
    tool.advance()
    assert tool.excursions == []
    clock.t = go(tool, (10.0, 0.0, -20.0, 40.0, 0.0, 0.0), down(0, -20)) + 1
    tool.advance()
    assert len(tool.excursions) == 1


def test_a_level_is_told_at_its_very_moment_once_and_in_order() -> None:
    tool, clock = make_world()
    told: list[tuple[str, float]] = []

    def note(name: str) -> Callable[[float], None]:
        return lambda t: told.append((name, t))

    for name, depth in (("deep", 2.0), ("touch", 1.0), ("forgotten", 1.5)):
        number = tool.watch(Watch("depth", depth, note(name)))
    tool.forget(number)
    tool.watch(Watch("depth", 1.0, note("away"), falling=True))
    go(tool, down(0, 3), down(0, -5), down(0, 3))
    clock.t = 30.0
    tool.advance()
    assert [name for name, _ in told] == ["touch", "deep", "away"]
    for (_, t), depth in zip(told, (1.0, 2.0, 1.0), strict=True):
        assert tool.truth(int(t * 1e9)).depth_mm == pytest.approx(depth, abs=1e-4)


def test_who_stops_at_a_level_is_never_deeper() -> None:
    tool, clock = make_world()
    tool.watch(Watch("force", 0.8, lambda t: tool.follow(t)))
    clock.t = go(tool, down(0, 4)) + 5
    assert tool.truth().depth_mm == pytest.approx(1.0, abs=1e-4)


def test_faults_fire_at_their_press_or_at_once() -> None:
    seen: list[tuple[str, float]] = []
    faults = (
        Fault("black-frames", press=2, depth_mm=1.0),
        Fault("alarm-1", press=2, depth_mm=1.5),
        Fault("hold", press=3, depth_mm=0.1),
        Fault("no-ok", press=1, depth_mm=9.0),
        Fault("unplug"),
    )
    tool, clock = make_world(faults=faults)
    kinds = ("black-frames", "alarm-1", "hold")
    tool.on_fault(dict.fromkeys(kinds, lambda f, t: seen.append((f.kind, t))))
    for _ in range(3):
        press(tool, clock, 2.0)
    tool.arm(Fault("pin-loss"))
    assert [(f.fault.kind, f.press, f.handled) for f in tool.fired] == [
        ("unplug", 0, False),
        ("black-frames", 2, True),
        ("alarm-1", 2, True),
        ("hold", 3, True),
        ("pin-loss", 3, False),
    ]
    for (_, t), depth in zip(seen, (1.0, 1.5, world.PRESS_DEPTH_MM), strict=True):
        assert tool.truth(int(t * 1e9)).depth_mm == pytest.approx(depth, abs=1e-4)


def test_another_indenter_touches_elsewhere() -> None:
    tool, clock = make_world()
    clock.t = go(tool, down(0, 1)) + 1
    assert len(tool.truth().contacts) == 1
    tool.mount(Indenter.dual(8.0))
    assert tool.truth().depth_mm < 1.0
    clock.t = go(tool, down(0, 3)) + 1
    assert len(tool.truth().contacts) == 2


def test_an_image_is_made_once_and_never_deeper_than_the_sensor_can() -> None:
    tool, clock = make_world()
    assert tool.image() is tool.rest
    clock.t = go(tool, down(0, 2)) + 1
    first = tool.image()
    assert first is tool.image()
    assert first.max() == 80 + 40
    assert not first.flags.writeable
    clock.t = go(tool, down(0, 12)) + 1
    assert 80 + 20 * 7.5 < tool.image().max() <= 80 + 20 * 8


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Fault("alarm-9"), "no fault 'alarm-9'; known are protective-stop"),
        (lambda: Fault("hold", press=0), "count from 1"),
        (lambda: simulated("tactip-128"), "unknown sensor 'tactip-128'"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(make: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        make()


def test_the_clock_is_the_hosts_times_the_scale() -> None:
    clock = Clock(20.0)
    assert clock.at(2 * 10**9) - clock.at(10**9) == pytest.approx(20.0)
    assert clock.now() >= 0


def test_the_records_do_not_grow_for_ever() -> None:
    tool, clock = make_world(rig=Rig(start=down(0, -20)))
    tool.keep_to(Envelope(x=(-1, 1)))
    for _ in range(world.EXCURSIONS + 100):
        clock.t = go(tool, down(2, -20), down(0, -20), speed=300)
    tool.advance()
    assert len(tool.excursions) == world.EXCURSIONS
