"""The UR emulator's ports, with plain sockets: its own process may serve these.

What a broken stream does to ur_rtde is not asked here: its receiving thread may abort the process.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from emulated import GraySensor
from ur_bench import SCRIPT

from tactibench import UserError
from tactibench_tactip.emulators import Fault, UrEmulator, World
from tactibench_tactip.emulators.ur import wire

HOST = "127.0.0.51"


class Client:
    """A stream of timestamps."""

    def __init__(self, host: str, hertz: float = 125.0) -> None:
        self.socket = socket.create_connection((host, 30004), timeout=3.0)
        self._splitter = wire.Splitter()
        self._waiting: list[tuple[int, bytes]] = []
        self.ask(wire.VERSION, struct.pack(">H", 2))
        self.ask(wire.OUTPUTS, struct.pack(">d", hertz) + b"timestamp,runtime_state")
        self.ask(wire.START, b"")

    def ask(self, kind: int, payload: bytes) -> bytes:
        for byte in wire.packed(kind, payload):  # in the smallest portions there are
            self.socket.sendall(bytes([byte]))
        return self.next(kind)

    def next(self, kind: int = wire.DATA) -> bytes:
        while True:
            for number, (found, payload) in enumerate(self._waiting):
                if found == kind:
                    del self._waiting[: number + 1]
                    return payload
            data = self.socket.recv(4096)
            if not data:
                raise EOFError
            self._waiting += self._splitter.feed(data)

    def timestamp(self) -> float:
        return float(struct.unpack(">BdI", self.next())[1])

    def timestamps(self, count: int) -> list[float]:
        return [self.timestamp() for _ in range(count)]


@pytest.fixture
def world() -> Iterator[World]:
    with World(GraySensor()) as world, UrEmulator(world, HOST):
        yield world


def test_a_stream_of_timestamps(world: World) -> None:
    client = Client(HOST)
    times = client.timestamps(20)
    assert times == sorted(times)
    assert times[-1] <= world.clock.now()
    client.socket.close()


def test_faults_of_the_stream(world: World) -> None:
    client = Client(HOST)
    client.timestamp()
    world.arm(Fault("frozen-stream", value=0.3))
    before = world.clock.now()
    while client.timestamp() < before:
        pass
    assert world.clock.now() >= before + 0.3
    world.arm(Fault("wrong-length", value=4))
    with pytest.raises(struct.error):  # four bytes of the next package, and then what comes
        client.timestamps(50)
    world.arm(Fault("socket-drop"))
    with pytest.raises((EOFError, ConnectionError, ValueError, struct.error)):
        client.timestamps(10_000)
    client.socket.close()
    again = Client(HOST)
    assert again.timestamp() > before
    again.socket.close()
    assert all(fired.taken for fired in world.fired)


def test_a_script_is_run_when_all_of_it_came(world: World) -> None:
    client = Client(HOST)
    script = socket.create_connection((HOST, 30003))
    text = SCRIPT.format(floats=0, ints=0).encode()
    script.sendall(text[:60])
    client.next()
    script.sendall(text[60:])
    while struct.unpack(">BdI", client.next())[2] != 2:
        pass
    world.arm(Fault("program-stop"))
    while struct.unpack(">BdI", client.next())[2] != 1:
        pass
    script.close()
    client.socket.close()


def test_the_dashboard_greets_answers_and_says_goodbye(world: World) -> None:
    dashboard = socket.create_connection((HOST, 29999), timeout=3.0)
    reader = dashboard.makefile()
    assert reader.readline() == "Connected: Universal Robots Dashboard Server\n"
    dashboard.sendall(b"robot")
    dashboard.sendall(b"mode\nsafetystatus\nquit\n")
    assert [reader.readline() for _ in range(3)] == [
        "Robotmode: RUNNING\n",
        "Safetystatus: NORMAL\n",
        "Disconnected\n",
    ]
    assert reader.readline() == ""
    dashboard.close()


def test_who_sends_nonsense_is_hung_up_on(world: World) -> None:
    client = socket.create_connection((HOST, 30004), timeout=3.0)
    client.sendall(b"\x00\x01V")
    assert client.recv(10) == b""
    client.close()


def test_a_taken_address_is_refused_and_nothing_stays() -> None:
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
