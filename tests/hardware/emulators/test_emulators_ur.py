"""The emulated UR: the script's handshake, safety, RTDE byte by byte, and its ports."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from emulated import SCRIPT, Arm, GraySensor
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import UserError
from tactibench_tactip.emulators import Fault
from tactibench_tactip.emulators.ur import RtdeSession, UrEmulator, package, split_packages
from tactibench_tactip.emulators.ur_controller import (
    MOVE_L,
    PLAYING,
    SAFE_POSE,
    SET_TCP,
    STOP_L,
    STOP_SCRIPT,
    STOPPED,
    WATCHDOG,
)
from tactibench_tactip.emulators.world import World

SPEED = (0.02, 0.5)
HOST = "127.0.0.51"


@pytest.fixture
def arm() -> Arm:
    arm = Arm()
    arm.load()
    assert arm.signal == 1
    assert arm.ur.runtime_state == PLAYING
    return arm


class TestScript:
    def test_a_move_is_done_at_once_and_its_word_tells_the_rest(self, arm: Arm) -> None:
        def word() -> tuple[int, int, int]:
            value = arm.ur.out_int[2]
            return value >> 15 & 1, value >> 16 & 0x7F, value >> 24 & 0x7F

        _, _, operation = word()
        arm.command(MOVE_L, *arm.target(-30), *SPEED)
        running, writes, number = word()
        assert (running, number) == (1, operation + 1)
        arm.after(0.5)
        assert -50 < arm.z() < -30
        arm.settle()
        assert word() == (0, writes + 1, number)
        assert arm.z() == pytest.approx(-30.0)

    def test_done_stands_until_the_client_clears_the_command(self, arm: Arm) -> None:
        arm.write(SET_TCP, 0, 0, 0.1, 0, 0, 0)
        arm.after(1.0)
        assert arm.signal == 2
        arm.write(0)
        assert arm.signal == 1

    def test_stop_brakes_as_hard_as_it_is_told(self, arm: Arm) -> None:
        arm.command(MOVE_L, *arm.target(0), *SPEED)
        arm.after(0.5)
        z = arm.z()
        arm.command(STOP_L, 0.1)
        arm.settle()
        assert arm.z() == pytest.approx(z + 20**2 / (2 * 100), abs=1e-3)

    def test_a_new_move_brakes_the_old_one_first(self, arm: Arm) -> None:
        arm.command(MOVE_L, *arm.target(0), *SPEED)
        arm.after(0.5)
        z = arm.z()
        arm.command(MOVE_L, *arm.target(-50), *SPEED)
        arm.after(0.04)
        assert arm.z() == pytest.approx(z + 20**2 / (2 * 500), abs=1e-3)
        arm.settle()
        assert arm.z() == pytest.approx(-50.0)

    @pytest.mark.parametrize(("seconds", "runs"), [(0.05, True), (0.2, False)])
    def test_the_watchdog_ends_the_program_and_the_motion(
        self, arm: Arm, seconds: float, runs: bool
    ) -> None:
        """By the host's clock: it passes fifty times as slowly as the world's here."""
        arm.command(WATCHDOG, 10.0)
        arm.command(MOVE_L, *arm.target(0), 0.001, 0.5)
        for _ in range(5):
            arm.after(50 * seconds, host=seconds)
            arm.write(0)
        assert (arm.ur.runtime_state == PLAYING) == runs
        z = arm.z()
        arm.after(2.0, host=0.04)
        assert (arm.z() > z) == runs

    def test_another_tcp_moves_the_pose_and_not_the_tool(self, arm: Arm) -> None:
        tool, pose = arm.world.tool(), arm.ur.pose()
        arm.command(SET_TCP, 0, 0, 0.1, 0, 0, 0)
        assert arm.world.tool() == tool
        distance = np.linalg.norm(arm.ur.pose()[:3] - pose[:3])
        assert distance == pytest.approx(0.1 - 0.0891)
        arm.command(MOVE_L, *pose, *SPEED)
        arm.settle()
        assert np.allclose(arm.ur.pose(), pose)
        assert arm.z() == pytest.approx(-50.0 - 10.9)

    def test_a_pose_out_of_reach_is_not_safe(self, arm: Arm) -> None:
        for pose, safe in ((arm.target(0), 1), ([3.0, 0, 0, 0, 0, 0], 0)):
            arm.command(SAFE_POSE, *pose)
            assert arm.ur.out_int[1] == safe

    def test_what_is_not_emulated_is_done_at_once(self, arm: Arm) -> None:
        arm.command(41, *[0.0] * 14)
        arm.write(STOP_SCRIPT)
        assert arm.ur.runtime_state == STOPPED
        arm.ur.load("def other():\n  popup(1)\nend\n", 0.0)
        assert arm.ur.runtime_state == STOPPED


class TestSafety:
    def test_too_much_force_is_a_protective_stop_and_again_after_an_unlock(self) -> None:
        arm = Arm(stop_force_n=1.6)  # 2 mm
        arm.load()
        arm.command(MOVE_L, *arm.target(5), *SPEED)
        arm.settle()
        assert arm.ask("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
        assert (arm.ur.safety_bits, arm.ur.safety_mode) == (1 << 2 | 1 << 10, 3)
        assert arm.ur.runtime_state == STOPPED
        braking = 20**2 / (2 * 5000)
        assert arm.world.truth().depth_mm == pytest.approx(2.0 + braking, abs=1e-3)
        arm.after(5.1)
        arm.ask("unlock protective stop")
        arm.load()
        arm.command(MOVE_L, *arm.target(6), *SPEED)
        arm.settle()
        assert arm.ask("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
        force = 1.6 + 1.0 + 2 * 0.8 * braking
        assert arm.world.truth().force_n == pytest.approx(force, abs=1e-3)

    def test_unlocking_waits_and_may_be_refused(self) -> None:
        arm = Arm(Fault("protective-stop", press=1, depth_mm=1.0))
        arm.load()
        arm.ur.refusals = 2
        arm.command(MOVE_L, *arm.target(3), *SPEED)
        arm.settle()
        assert arm.world.truth().depth_mm == pytest.approx(1.04, abs=1e-3)
        refused = arm.ask("unlock protective stop")
        assert refused.startswith("Cannot unlock protective stop until 5s")
        arm.after(5.1)
        assert [arm.ask("unlock protective stop") for _ in range(3)] == [
            refused,
            refused,
            "Protective stop releasing",
        ]
        assert arm.ur.safety_bits == 1
        arm.load()
        arm.command(MOVE_L, *arm.target(-20), *SPEED)
        arm.settle()
        assert arm.z() == pytest.approx(-20.0)

    def test_nothing_unlocks_an_emergency_stop(self, arm: Arm) -> None:
        arm.ur.emergency_stop(0.0)
        arm.after(60.0)
        arm.ask("unlock protective stop")
        assert arm.ask("robotmode") == "Robotmode: POWER_OFF"
        assert arm.ask("safetystatus") == "Safetystatus: ROBOT_EMERGENCY_STOP"
        arm.load()
        assert arm.ur.runtime_state == STOPPED

    def test_in_local_mode_no_script_runs_and_the_dashboard_only_reads(self) -> None:
        arm = Arm(remote=False)
        arm.load()
        assert arm.ur.runtime_state == STOPPED
        assert arm.ask("is in remote control") == "false"
        assert "local" in arm.ask("stop")
        assert arm.ask("PolyscopeVersion") == "URSoftware 5.12.2.1101534 (Mar 24 2022)"
        assert arm.ask("nonsense") == 'could not understand: "nonsense"'


class TestRtde:
    @pytest.fixture
    def session(self, arm: Arm) -> RtdeSession:
        return RtdeSession(arm.ur, ("input_int_register_3",))

    def ask(self, session: RtdeSession, kind: str, payload: bytes = b"") -> bytes:
        ((answered, reply),), rest = split_packages(session.feed(package(kind, payload), 0.0))
        assert (answered, rest) == (kind, b"")
        return reply

    def test_versions(self, session: RtdeSession) -> None:
        assert self.ask(session, "V", struct.pack(">H", 2)) == b"\x01"
        assert self.ask(session, "V", struct.pack(">H", 7)) == b"\x00"
        assert struct.unpack(">4I", self.ask(session, "v")) == (5, 12, 2, 1101534)

    def test_outputs_are_packed_in_the_order_asked_for(self, session: RtdeSession) -> None:
        names = b"output_int_register_1,timestamp,robot_mode,actual_TCP_pose,"
        reply = self.ask(session, "O", struct.pack(">d", 125.0) + names)
        assert reply == b"\x01INT32,DOUBLE,INT32,VECTOR6D"
        assert session.hertz == 125.0
        assert self.ask(session, "S") == b"\x01"
        ((kind, data),), _ = split_packages(session.sample())
        assert kind == "U"
        number, register, t, mode, *pose = struct.unpack(">Bidi6d", data)
        assert (number, register, t, mode) == (1, 0, 0.0, 7)
        assert pose[:3] == pytest.approx([0.1091, -0.487, 0.3913])

    def test_what_is_not_known_or_not_free_is_said(self, session: RtdeSession) -> None:
        reply = self.ask(session, "O", struct.pack(">d", 125.0) + b"timestamp,nonsense")
        assert reply.endswith(b"DOUBLE,NOT_FOUND")
        assert self.ask(session, "S") == b"\x00"
        reply = self.ask(session, "I", b"input_int_register_0,input_int_register_3")
        assert reply == b"\x00INT32,IN_USE"
        for number in (1, 2, 3):
            reply = self.ask(session, "I", b"input_int_register_0,input_double_register_1,")
            assert reply == bytes([number]) + b"INT32,DOUBLE"

    def test_an_input_package_writes_its_registers(self, arm: Arm, session: RtdeSession) -> None:
        self.ask(session, "I", b"input_double_register_4,input_int_register_1")
        session.feed(package("U", b"\x01" + struct.pack(">di", 0.25, -7)), 0.0)
        assert arm.ur.inputs == {"input_double_register_4": 0.25, "input_int_register_1": -7}

    @pytest.mark.parametrize(
        "data",
        [
            package("U", b"\x05abc"),
            package("U", b""),
            package("O", b"\x00"),
            package("Z", b""),
            b"\x00\x02V",
        ],
    )
    def test_what_is_no_rtde_is_refused(self, session: RtdeSession, data: bytes) -> None:
        with pytest.raises(ValueError, match="package"):
            session.feed(data, 0.0)

    @settings(max_examples=40, deadline=None)
    @given(st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40))), st.data())
    def test_packages_come_out_whole_however_the_bytes_come_in(
        self, packages: list[tuple[int, bytes]], data: st.DataObject
    ) -> None:
        sent = [(chr(kind), payload) for kind, payload in packages]
        stream = b"".join(package(kind, payload) for kind, payload in sent)
        received: list[tuple[str, bytes]] = []
        rest, at = b"", 0
        while at < len(stream):
            step = data.draw(st.integers(1, len(stream) - at))
            whole, rest = split_packages(rest + stream[at : at + step])
            received += whole
            at += step
        assert (received, rest) == (sent, b"")


class Client:
    """A stream of timestamps and runtime states."""

    def __init__(self) -> None:
        self.socket = socket.create_connection((HOST, 30004), timeout=3.0)
        self._rest = b""
        self._packages: list[tuple[str, bytes]] = []
        self.ask("V", struct.pack(">H", 2))
        self.ask("O", struct.pack(">d", 125.0) + b"timestamp,runtime_state")
        self.ask("S", b"")

    def ask(self, kind: str, payload: bytes) -> bytes:
        for byte in package(kind, payload):  # in the smallest portions there are
            self.socket.sendall(bytes([byte]))
        return self.next(kind)

    def next(self, kind: str = "U") -> bytes:
        while True:
            for number, (name, payload) in enumerate(self._packages):
                if name == kind:
                    del self._packages[: number + 1]
                    return payload
            data = self.socket.recv(4096)
            if not data:
                raise EOFError
            packages, self._rest = split_packages(self._rest + data)
            self._packages += packages

    def sample(self) -> tuple[float, int]:
        _, timestamp, state = struct.unpack(">BdI", self.next())
        return timestamp, state

    def samples(self, count: int) -> list[tuple[float, int]]:
        return [self.sample() for _ in range(count)]


@pytest.mark.long
class TestPorts:
    """With plain sockets: what a broken stream does to ur_rtde may abort its process."""

    @pytest.fixture
    def world(self) -> Iterator[World]:
        world = World(GraySensor())
        with UrEmulator(world, HOST):
            yield world

    def test_faults_of_the_stream(self, world: World) -> None:
        client = Client()
        times = [t for t, _ in client.samples(20)]
        assert times == sorted(times)
        world.arm(Fault("frozen-stream", value=0.3))
        before = world.clock.now()
        while client.sample()[0] < before:
            pass
        assert world.clock.now() >= before + 0.3
        world.arm(Fault("wrong-length", value=4))
        with pytest.raises(struct.error):  # four bytes of the next package, and then what comes
            client.samples(50)
        world.arm(Fault("socket-drop"))
        with pytest.raises((EOFError, ConnectionError, ValueError, struct.error)):
            client.samples(10_000)
        client.socket.close()
        again = Client()
        assert again.sample()[0] > before
        again.socket.close()
        assert all(event.handled for event in world.fired)

    def test_a_script_is_run_when_all_of_it_came(self, world: World) -> None:
        client = Client()
        with socket.create_connection((HOST, 30003)) as connection:
            connection.sendall(SCRIPT[:60].encode())
            assert client.sample()[1] == STOPPED
            connection.sendall(SCRIPT[60:].encode())
            while client.sample()[1] != PLAYING:
                pass
            world.arm(Fault("program-stop"))
            while client.sample()[1] != STOPPED:
                pass
        client.socket.close()

    def test_the_dashboard_greets_and_answers(self, world: World) -> None:
        with socket.create_connection((HOST, 29999), timeout=3.0) as dashboard:
            reader = dashboard.makefile()
            assert reader.readline() == "Connected: Universal Robots Dashboard Server\n"
            dashboard.sendall(b"robot")
            dashboard.sendall(b"mode\nsafetystatus\n")
            assert reader.readline() == "Robotmode: RUNNING\n"
            assert reader.readline() == "Safetystatus: NORMAL\n"
            reader.close()

    def test_who_sends_nonsense_is_hung_up_on(self, world: World) -> None:
        with socket.create_connection((HOST, 30004), timeout=3.0) as client:
            client.sendall(b"\x00\x01V")
            assert client.recv(10) == b""

    def test_a_taken_address_is_refused_and_nothing_stays(self) -> None:
        before = set(threading.enumerate())
        free = "127.0.0.44"
        with UrEmulator(World(GraySensor()), free):
            with pytest.raises(UserError, match=r"port 30004 of 127\.0\.0\.44 cannot be opened"):
                UrEmulator(World(GraySensor()), free).start()
            connection = socket.create_connection((free, 29999))
            assert connection.recv(100).startswith(b"Connected")
        assert connection.recv(100) == b""
        connection.close()
        assert set(threading.enumerate()) == before
        with UrEmulator(World(GraySensor()), free):
            pass
