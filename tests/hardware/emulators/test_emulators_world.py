"""The shared world on a clock that is set by hand."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from emulated import GraySensor, HandClock
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, UserError
from tactibench_tactip.emulators import (
    Clock,
    Envelope,
    Fault,
    Log,
    Pose6,
    Rig,
    Stretch,
    World,
    route,
    simulated,
)
from tactibench_tactip.emulators.levels import Level
from tactibench_tactip.emulators.motion import Line, trapezoid
from tactibench_tactip.emulators.poses import matrix

SPEED, RATE = 20.0, 500.0


def a_world(**given: object) -> tuple[World, HandClock]:
    clock = HandClock()
    return World(GraySensor(), clock=clock, **given), clock  # type: ignore[arg-type]


def go(world: World, *poses: Pose6, speed: float = SPEED) -> float:
    """Plan a way through poses of the work frame; returns when it ends."""
    with world.lock:
        t = world.advance()
        here, steps = world.pose_at(t), []
        for pose in poses:
            line = Line(here, matrix(pose))
            steps.append((line.end, trapezoid(line.length, speed, RATE)))
            here = line.end
        world.follow(t, steps)
        return world.still_s


def down(x: float, z: float) -> Pose6:
    return (x, 0.0, z, 0.0, 0.0, 0.0)


def press(world: World, clock: HandClock, depth: float, steps: int = 7) -> None:
    end = go(world, down(0, -2), down(0, depth), down(0, -5))
    start = clock.t
    for k in range(steps):
        clock.t = start + (end - start) * (k + 1) / steps
        world.advance()


def test_the_tool_is_where_the_profile_says() -> None:
    world, clock = a_world()
    end = go(world, down(0, -10))
    assert end == pytest.approx(40 / SPEED + SPEED / RATE)
    clock.go(1.0)
    assert world.tool()[2] == pytest.approx(-50 + SPEED * (1.0 - SPEED / RATE / 2))
    clock.t = end
    assert world.tool() == pytest.approx(down(0, -10))


def test_truth_tells_depth_and_force_now_and_before() -> None:
    world, clock = a_world()
    end = go(world, down(0, 3), down(0, -5))
    clock.t = end + 1
    touched = (50 + 3) / SPEED + SPEED / RATE
    assert world.truth(int(touched * 1e9)).depth_mm == pytest.approx(3.0, abs=1e-3)
    assert world.truth(int(touched * 1e9)).force_n == pytest.approx(2.4, abs=1e-3)
    assert world.truth().scene is None
    assert world.truth_of(down(0, 2)).depth_mm == pytest.approx(2.0)
    assert world.truth(int((end + 99) * 1e9)).tool == world.tool()


def test_a_moment_that_is_not_kept_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route, "KEPT", 40)
    world, clock = a_world()
    for k in range(60):
        go(world, down(0, -30 - k % 2))
        clock.go(0.01)
    clock.go(9.0)
    assert world.truth(int((clock.t - 1) * 1e9)).tool == world.tool()
    with pytest.raises(ValueError, match="no longer kept"):
        world.truth(int(0.05e9))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.05, 4.0), min_size=1, max_size=8), st.integers(1, 40))
def test_a_press_is_counted_once_however_often_somebody_looks(
    depths: Sequence[float], steps: int
) -> None:
    world, clock = a_world(press_depth_mm=0.4)
    for depth in depths:
        press(world, clock, depth, steps)
    counted = [depth for depth in depths if depth > 0.4]
    assert world.presses == len(counted)
    assert [p.deepest_mm for p in world.log.presses] == pytest.approx(counted, abs=1e-6)
    assert [p.number for p in world.log.presses] == list(range(1, len(counted) + 1))


@settings(max_examples=30, deadline=None)
@given(st.floats(-19, 19), st.floats(0, 40), st.floats(-4, 4), st.integers(1, 9))
def test_every_moment_outside_the_envelope_is_seen_however_rarely_one_looks(
    x: float, over: float, back: float, steps: int
) -> None:
    box = Envelope(x=(-20, 20), y=(-20, 20), z=(-60, 6.5))
    world, clock = a_world(envelope=box)
    end = go(world, down(x, -20), (x + over, back, -20.0, 0, 0, 0), down(0, -20), speed=300)
    for k in range(steps):
        clock.t = end * (k + 1) / steps
        world.advance()
    left = x + over > 20 + box.slack_mm
    assert bool(world.log.outside) == left
    assert not left or max(max(s.start[0], s.end[0]) for s in world.log.outside) > 20


def test_a_tilt_in_the_middle_of_a_way_is_seen() -> None:
    """From 30 deg about x to -30 deg about x by a turn about another axis."""
    world, clock = a_world(envelope=Envelope(tilt=31.0), rig=Rig(start=(0, 0, -20, 30, 0, 0)))
    clock.t = go(world, (0.0, 0.0, -20.0, -30.0, 0.0, 180.0)) + 1
    world.advance()
    assert not world.log.outside  # the axis itself stays where it is: a turn by 180 deg about z
    clock.t = go(world, (0.0, 0.0, -20.0, 40.0, 0.0, 0.0)) + 1
    world.advance()
    assert world.log.outside


def test_the_envelope_can_begin_later() -> None:
    world, clock = a_world(envelope=None)
    clock.t = go(world, down(60, -20), down(0, -20))
    world.keep_to(Envelope())
    clock.t = go(world, down(10, -20))
    world.advance()
    assert not world.log.outside
    world.keep_to(Envelope(x=(-1, 1)))
    clock.t = go(world, down(5, -20))
    world.advance()
    assert len(world.log.outside) == 1


def test_a_level_is_told_at_its_very_moment_and_once() -> None:
    world, clock = a_world()
    told: list[float] = []
    world.watch(Level("depth", 1.0, told.append))
    go(world, down(0, 2), down(0, -5), down(0, 2))
    clock.go(20.0)
    world.advance()
    (t,) = told
    assert world.truth(int(t * 1e9)).depth_mm == pytest.approx(1.0, abs=1e-4)


def test_who_stops_at_a_level_is_never_deeper() -> None:
    world, clock = a_world()
    world.watch(Level("force", 0.8, lambda t: world.follow(t, ())))
    end = go(world, down(0, 4))
    clock.t = end + 5
    assert world.truth().depth_mm == pytest.approx(1.0, abs=1e-4)
    assert max(s.end[2] for s in world.log.stretches) == pytest.approx(1.0, abs=1e-4)


def test_events_come_in_the_order_of_the_worlds_time() -> None:
    world, clock = a_world()
    told: list[str] = []
    end = go(world, down(0, 3))
    world.alarm(end + 1, lambda t: told.append("late"))
    world.alarm(0.1, lambda t: told.append("early"))
    world.watch(Level("depth", 2.0, lambda t: told.append("deep")))
    number = world.watch(Level("depth", 2.5, lambda t: told.append("forgotten")))
    world.watch(Level("depth", 1.0, lambda t: told.append("touch")))
    world.forget(number)
    clock.t = end + 2
    world.advance()
    assert told == ["early", "touch", "deep", "late"]


def test_faults_fire_at_their_press_at_their_time_or_at_once() -> None:
    seen: list[tuple[str, float]] = []
    faults = (
        Fault("black-frames", press=2, depth_mm=1.0),
        Fault("alarm-1", press=2, depth_mm=1.0),
        Fault("hold", press=3, depth_mm=0.1),
        Fault("no-ok", press=1, depth_mm=9.0),
        Fault("unplug", at_s=1.5),
    )
    world, clock = a_world(faults=faults)
    world.answer(["black-frames", "alarm-1", "hold"], lambda f, t: seen.append((f.kind, t)))
    for _ in range(3):
        press(world, clock, 2.0)
    world.arm(Fault("pin-loss"))
    kinds = [(f.fault.kind, f.press, f.taken) for f in world.fired]
    assert kinds == [
        ("unplug", 0, False),
        ("black-frames", 2, True),
        ("alarm-1", 2, True),
        ("hold", 3, True),
        ("pin-loss", 3, False),
    ]
    assert world.truth(int(seen[0][1] * 1e9)).depth_mm == pytest.approx(1.0, abs=1e-4)


def test_another_indenter_touches_elsewhere() -> None:
    world, clock = a_world()
    end = go(world, down(0, 1))
    clock.t = end + 1
    assert len(world.truth().contacts) == 1
    world.mount(Indenter.dual(8.0))
    assert world.truth().depth_mm < 1.0
    clock.t = go(world, down(0, 3)) + 1
    assert len(world.truth().contacts) == 2
    assert world.rig.indenter.name == "dual"


def test_an_image_is_made_once_and_never_deeper_than_the_sensor_can() -> None:
    world, clock = a_world()
    assert world.image() is world.view.rest
    clock.t = go(world, down(0, 2)) + 1
    first = world.image()
    assert first is world.image()
    assert first.max() == 80 + 40
    assert not first.flags.writeable
    clock.t = go(world, down(0, 12)) + 1
    assert 80 + 20 * 7.5 < world.image().max() <= 80 + 20 * 8


def test_bad_input_is_refused_in_a_sentence() -> None:
    with pytest.raises(UserError, match="time scale is 0;"):
        Clock(0.0)
    with pytest.raises(UserError, match="no fault 'alarm-9'; known are protective-stop"):
        Fault("alarm-9")
    with pytest.raises(UserError, match="press and a time"):
        Fault("hold", press=1, at_s=2.0)
    with pytest.raises(UserError, match="count from 1"):
        Fault("hold", press=0)
    with pytest.raises(UserError, match="unknown sensor 'tactip-128'"):
        simulated("tactip-128")
    with pytest.raises(UserError, match="no parameter"):
        simulated("tactip-127", pinz=3)


def test_the_clock_is_the_hosts_times_the_scale() -> None:
    clock = Clock(20.0)
    first = clock.at(10**9)
    assert clock.at(2 * 10**9) - first == pytest.approx(20.0)
    assert clock.host_seconds(5.0) == pytest.approx(0.25)
    assert clock.now() >= 0


def test_the_log_does_not_grow_for_ever() -> None:
    log = Log()
    for k in range(5000):
        log.add(Stretch(k, k + 1, down(0, 0), down(0, 1), inside=k % 2 == 0))
    assert (log.count, len(log.stretches), len(log.outside)) == (5000, 4096, 1000)
