"""The control script's handshake, its traps, and the safety of the controller."""

from __future__ import annotations

import numpy as np
import pytest
from ur_bench import UrBench

from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.poses import from_ur
from tactibench_tactip.emulators.ur import kinematics

MOVE_L, STOP_L, WATCHDOG = 3, 33, 35


@pytest.fixture
def ur() -> UrBench:
    bench = UrBench()
    bench.load()
    assert bench.signal == 1
    assert bench.ur.runtime_state == 2
    assert bench.ask("programState").startswith("PLAYING")
    return bench


def progress(bench: UrBench) -> dict[str, int]:
    word = bench.ur.out_int[2 + bench.offset]
    return {
        "progress": word & 0x7FFF,
        "running": word >> 15 & 1,
        "writes": word >> 16 & 0x7F,
        "operation": word >> 24 & 0x7F,
    }


def test_a_move_ends_with_done_and_ready_comes_when_it_is_cleared(ur: UrBench) -> None:
    ur.write(MOVE_L, [*ur.target(0, 0, -30), 0.02, 0.5], i1=0)
    ur.after(0.5)
    assert ur.signal == 1
    assert -50 < ur.z() < -30
    ur.after(0.6)
    assert ur.signal == 2
    assert ur.z() == pytest.approx(-30.0)
    ur.after(1.0)
    assert ur.signal == 2  # until the client clears the command
    ur.write(0)
    assert ur.signal == 1


def test_a_watchdog_kick_in_a_blocking_move_loses_the_done(ur: UrBench) -> None:
    """The kick writes 0, so that done stands for one turn of the loop only."""
    ur.write(MOVE_L, [*ur.target(0, 0, -30), 0.02, 0.5], i1=0)
    seen = []
    for _ in range(1100):
        ur.after(0.001)
        ur.write(0)
        seen.append(ur.signal)
    assert seen.count(2) <= 3
    assert seen[-1] == 1


def test_an_asynchronous_move_is_done_at_once_and_its_word_tells_the_rest(ur: UrBench) -> None:
    before = progress(ur)
    ur.command(MOVE_L, [*ur.target(0, 0, -30), 0.02, 0.5], i1=1)
    running = progress(ur)
    assert running["running"] == 1
    assert running["operation"] == before["operation"] + 1
    ur.after(2.0)
    ended = progress(ur)
    assert ended["running"] == 0
    assert ended["operation"] == running["operation"]
    assert ended["writes"] == running["writes"] + 1
    assert ur.z() == pytest.approx(-30.0)


def test_stop_brakes_as_hard_as_it_is_told(ur: UrBench) -> None:
    ur.command(MOVE_L, [*ur.target(0, 0, 0), 0.02, 0.5], i1=1)
    ur.after(0.5)
    z = ur.z()
    ur.command(STOP_L, [0.1], i1=0)
    assert ur.z() == pytest.approx(z + 20**2 / (2 * 100), abs=0.02)
    assert progress(ur)["running"] == 0


def test_a_new_move_brakes_the_old_one_first(ur: UrBench) -> None:
    ur.command(MOVE_L, [*ur.target(0, 0, 0), 0.02, 0.5], i1=1)
    ur.after(0.5)
    ur.command(MOVE_L, [*ur.target(0, 0, -50), 0.02, 0.5], i1=0)
    assert ur.z() == pytest.approx(-50.0)
    ends = [s.end[2] for s in ur.world.log.stretches]
    assert max(np.abs(np.diff([-50.0, *ends]))) < 0.5  # no jump


@pytest.mark.parametrize("offset", [0, 24])
def test_the_upper_registers_work_alike(offset: int) -> None:
    bench = UrBench()
    bench.load(offset)
    bench.command(MOVE_L, [*bench.target(0, 0, -40), 0.02, 0.5], i1=0)
    assert bench.z() == pytest.approx(-40.0)


def test_the_watchdog_ends_the_program_and_the_motion(ur: UrBench) -> None:
    ur.command(WATCHDOG, [10.0])
    ur.command(MOVE_L, [*ur.target(0, 0, 0), 0.02, 0.5], i1=1)
    for _ in range(10):
        ur.after(0.05)
        ur.write(0)
    assert ur.ur.runtime_state == 2
    ur.after(0.5)
    assert ur.ur.runtime_state == 1
    z = ur.z()
    ur.after(1.0)
    assert ur.z() == z
    assert "watchdog" in ur.ur.messages[-1]


def test_the_watchdog_goes_by_the_hosts_clock() -> None:
    """At 50 times the speed a host that kicks 20 times a second is fast enough for 10 Hz."""
    bench = UrBench()
    bench.load()
    bench.command(WATCHDOG, [10.0])
    for _ in range(20):
        bench.after(2.5, host=0.05)
        bench.write(0)
    assert bench.ur.runtime_state == 2


def test_too_much_force_is_a_protective_stop() -> None:
    bench = UrBench(stop_force_n=1.6)  # 2 mm
    bench.load()
    bench.command(MOVE_L, [*bench.target(0, 0, 5), 0.02, 0.5], i1=0)
    assert bench.ask("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert bench.ur.safety_bits == 1 << 2 | 1 << 10
    assert bench.ur.safety_mode == 3
    assert bench.ur.runtime_state == 1
    assert bench.world.truth().depth_mm == pytest.approx(2.0 + 20**2 / (2 * 5000), abs=1e-3)


def test_after_an_unlock_it_stops_again_when_it_is_pushed_on() -> None:
    bench = UrBench(stop_force_n=1.6)
    bench.load()
    bench.command(MOVE_L, [*bench.target(0, 0, 5), 0.02, 0.5], i1=0)
    bench.after(5.1)
    bench.ask("unlock protective stop")
    bench.load()
    bench.command(MOVE_L, [*bench.target(0, 0, 6), 0.02, 0.5], i1=0)
    assert bench.ask("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert bench.world.truth().force_n == pytest.approx(1.6 + 1.0 + 2 * 0.8 * 0.04, abs=1e-3)


def test_unlocking_waits_and_may_be_refused() -> None:
    bench = UrBench(faults=(Fault("protective-stop", press=1, depth_mm=1.0),))
    bench.world.answer(["protective-stop"], lambda f, t: bench.ur.protective_stop(t))
    bench.load()
    bench.ur.refusals = 2
    bench.command(MOVE_L, [*bench.target(0, 0, 3), 0.02, 0.5], i1=0)
    assert bench.world.truth().depth_mm == pytest.approx(1.04, abs=1e-3)
    assert bench.ask("unlock protective stop").startswith("Cannot unlock protective stop until 5s")
    bench.after(5.1)
    assert bench.ask("unlock protective stop").startswith("Cannot unlock")
    assert bench.ask("unlock protective stop").startswith("Cannot unlock")
    assert bench.ask("unlock protective stop") == "Protective stop releasing"
    assert bench.ur.safety_bits == 1
    bench.load()
    bench.command(MOVE_L, [*bench.target(0, 0, -20), 0.02, 0.5], i1=0)
    assert bench.z() == pytest.approx(-20.0)


def test_nothing_unlocks_an_emergency_stop() -> None:
    bench = UrBench()
    bench.load()
    bench.ur.emergency_stop(0.0)
    bench.after(60.0)
    bench.ask("unlock protective stop")
    assert bench.ask("robotmode") == "Robotmode: POWER_OFF"
    assert bench.ask("safetystatus") == "Safetystatus: ROBOT_EMERGENCY_STOP"
    bench.load()
    assert bench.ur.runtime_state == 1
    assert "refused" in bench.ur.messages[-1]


def test_until_contact_comes_back_to_where_it_was_seen(ur: UrBench) -> None:
    ur.command(51, [*[0, 0, -0.02, 0, 0, 0], *[0.0] * 6, 0.5])
    assert ur.world.truth().force_n == pytest.approx(2.0, abs=1e-3)
    assert ur.world.truth().depth_mm == pytest.approx(2.5, abs=1e-3)


def test_until_contact_does_nothing_on_a_cb3_and_says_done() -> None:
    bench = UrBench(version=(3, 15, 0, 1))
    bench.load()
    bench.command(51, [*[0, 0, -0.02, 0, 0, 0], *[0.0] * 6, 0.5])
    assert bench.signal == 1
    assert bench.z() == -50.0


def test_contact_detection_stops_a_move(ur: UrBench) -> None:
    ur.command(62, [0.0] * 6)
    ur.command(MOVE_L, [*ur.target(0, 0, 6), 0.02, 0.5], i1=1)
    ur.after(6.0)
    assert ur.world.truth().depth_mm == pytest.approx(2.5, abs=1e-3)
    ur.command(64)
    assert ur.ur.out_int[1] == 1
    ur.command(63)
    ur.command(MOVE_L, [*ur.target(0, 0, 6), 0.02, 0.5], i1=0)
    assert ur.z() == pytest.approx(6.0)


def test_speed_goes_on_until_it_is_stopped(ur: UrBench) -> None:
    ur.write(10, [0, 0, -0.01, 0, 0, 0, 0.5, 0.0])  # a realtime command: nobody waits for it
    ur.after(1.0)
    assert ur.signal == 1
    assert ur.z() == pytest.approx(-40.0 - 10**2 / (2 * 500))
    ur.command(15, [0.5])
    z = ur.z()
    ur.after(1.0)
    assert ur.z() == z


def test_another_tcp_moves_the_pose_and_not_the_tool(ur: UrBench) -> None:
    tool, pose = ur.world.tool(), ur.pose()
    ur.command(29, [0, 0, 0.1, 0, 0, 0])
    assert ur.world.tool() == tool
    assert np.allclose(np.linalg.norm(ur.pose()[:3, 3] - pose[:3, 3]), 100 - 89.1)
    ur.command(40)
    assert ur.ur.out_double[:6] == pytest.approx([0, 0, 0.1, 0, 0, 0])


def test_what_is_not_emulated_is_said_and_done(ur: UrBench) -> None:
    ur.command(41, [0.0] * 14)
    assert "command 41 is not emulated" in ur.ur.messages[-1]
    ur.ur.load("def other():\n  popup(1)\nend\n", 0.0)
    assert "not emulated" in ur.ur.messages[-1]
    assert ur.ur.runtime_state == 1


def test_stop_script_ends_the_program(ur: UrBench) -> None:
    ur.write(255)
    assert ur.ur.runtime_state == 1
    assert ur.ask("running") == "Program running: false"


def test_steady_is_half_a_second_of_rest(ur: UrBench) -> None:
    ur.command(MOVE_L, [*ur.target(0, 0, -30), 0.02, 0.5], i1=0)
    ur.command(47)
    assert ur.ur.out_int[1] == 0
    ur.after(0.6)
    ur.command(47)
    assert ur.ur.out_int[1] == 1


def test_in_local_mode_no_script_runs_and_the_dashboard_only_reads() -> None:
    bench = UrBench(remote=False)
    bench.load()
    assert bench.ur.runtime_state == 1
    assert bench.ask("is in remote control") == "false"
    assert "local" in bench.ask("stop")
    assert bench.ask("PolyscopeVersion") == "URSoftware 5.12.2.1101534 (Mar 24 2022)"
    assert bench.ask("nonsense") == 'could not understand: "nonsense"'


def test_the_flange_of_a_ur5e_in_its_zero_position() -> None:
    """Sums of the link lengths in UR's table: x = a2 + a3, y = -(d4 + d6), z = d1 - d5."""
    assert kinematics.flange(np.zeros(6))[:3, 3] == pytest.approx([-817.2, -232.9, 62.8])


def test_joints_lead_to_the_pose_that_they_were_asked_for(ur: UrBench) -> None:
    near = np.array(kinematics.START)
    rng = np.random.default_rng(1)
    for _ in range(5):
        wanted = near + rng.uniform(-0.4, 0.4, 6)
        target = kinematics.flange(wanted)
        q = kinematics.joints(target, near)
        assert q is not None
        assert np.allclose(kinematics.flange(q), target, atol=1e-4)
    ur.command(46, ur.target(0, 0, 0))
    end = kinematics.flange(np.array(ur.ur.out_double[:6])) @ ur.arm.tcp
    assert np.allclose(end, from_ur(ur.target(0, 0, 0)), atol=1e-3)
    ur.command(36, ur.target(0, 0, 0))
    assert ur.ur.out_int[1] == 1
    ur.command(36, [3.0, 0, 0, 0, 0, 0])
    assert ur.ur.out_int[1] == 0
