"""The servers of a UR controller as ur_rtde 1.6 needs them: RTDE, script and dashboard.

It answers the commands that the driver sends, and goes a tenth of its way between two samples, so
that a test does not wait for it. RTDE as in UR's guide "Real-Time Data Exchange", version 2.
"""

from __future__ import annotations

import re
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Self

HEADER = struct.Struct(">HB")
MOVE_L, SET_TCP, STOP_L, WATCHDOG, SAFE_POSE, GET_TCP, STOP_SCRIPT = 3, 29, 33, 35, 36, 40, 255
SAFETY = {
    "NORMAL": (1, 1),
    "PROTECTIVE_STOP": (3, 1 << 2 | 1 << 10),
    "ROBOT_EMERGENCY_STOP": (7, 1 << 6 | 1 << 7 | 1 << 10),
}
"""Name on the dashboard -> safety_mode, safety_status_bits."""
OUTPUTS: dict[str, tuple[str, Callable[[ScriptedUr], Any]]] = {
    "timestamp": ("DOUBLE", lambda ur: time.monotonic()),
    "actual_TCP_pose": ("VECTOR6D", lambda ur: ur.pose),
    "actual_TCP_force": ("VECTOR6D", lambda ur: ur.force),
    "robot_mode": ("INT32", lambda ur: ur.mode),
    "safety_mode": ("INT32", lambda ur: SAFETY[ur.safety][0]),
    "runtime_state": ("UINT32", lambda ur: 2 if ur.runs else 1),
    "robot_status_bits": ("UINT32", lambda ur: 1 | ur.runs << 1),
    "safety_status_bits": ("UINT32", lambda ur: SAFETY[ur.safety][1]),
    "target_speed_fraction": ("DOUBLE", lambda ur: ur.slider),
    "payload": ("DOUBLE", lambda ur: 1.2),
    "payload_cog": ("VECTOR3D", lambda ur: (0.0, -0.01, 0.045)),
    **{
        f"output_int_register_{k}": ("INT32", lambda ur, k=k: ur.out_int[k])  # type: ignore[misc]
        for k in range(3)
    },
    **{
        f"output_double_register_{k}": ("DOUBLE", lambda ur, k=k: ur.tcp[k])  # type: ignore[misc]
        for k in range(6)
    },
}
"""Field that ur_rtde asks for -> its type, and the function that returns its value."""
INPUTS = {
    **{f"input_int_register_{k}": "INT32" for k in range(8)},
    **{f"input_double_register_{k}": "DOUBLE" for k in range(18)},
    "external_force_torque": "VECTOR6D",
}
FORMATS = {"UINT32": "I", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d", "VECTOR6D": "6d"}


class ScriptedUr:
    """A UR5e at a loopback address of its own.

    Attributes:
        pose: Pose of the TCP, m and a rotation vector, rad.
        tcp: TCP of the pendant.
        safety: Safety status, a key of SAFETY.
        runs: Whether a program runs.
        program: What the dashboard says of it.
        slider: Share of the speed that the pendant allows.
        stopped: Number of the stops that the dashboard was asked for.
        turns: Number of turns of its loop in a move.
        scripts: Number of the scripts that it was sent.
        frozen: Whether the stream stands still.
        commands: Numbers of the commands that were carried out.
        watchdog_hz: Rate of the watchdog that was set.
    """

    def __init__(
        self,
        host: str,
        *,
        remote: bool = True,
        in_use: str = "",
        tcp_mm: float = 89.1,
        lacks: tuple[str, ...] = (),
    ) -> None:
        self.host, self._remote, self._in_use, self._lacks = host, remote, in_use, lacks
        self.turns = 10
        self.program, self.slider, self.stopped, self.scripts = "STOPPED grip.urp", 1.0, 0, 0
        self.pose = [0.1, -0.5, 0.4, 2.2214, -2.2214, 0.0]
        self.tcp = [0.0, 0.0, 1e-3 * tcp_mm, 0.0, 0.0, 0.0]
        self.force = [0.0] * 6
        self.safety, self.mode, self.runs, self.frozen = "NORMAL", 7, False, False
        self.out_int = [0, 0, 0]
        self.commands: list[int] = []
        self.watchdog_hz = 0.0
        self._inputs: dict[str, float] = {}
        self._executing = False
        self._target, self._left = self.pose, 0
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._servers: list[socket.socket] = []

    def __enter__(self) -> Self:
        for port, talk in ((30004, self._rtde), (30003, self._script), (29999, self._dashboard)):
            server = socket.create_server((self.host, port))
            self._servers.append(server)
            threading.Thread(target=self._accept, args=(server, talk), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        for server in self._servers:
            with suppress(OSError):
                server.shutdown(socket.SHUT_RDWR)
            server.close()

    def hang_up(self) -> None:
        """Cut all connections and answer none."""
        self._end.set()

    def stop_with(self, safety: str) -> None:
        """Stop protectively, or as the red button does."""
        self.safety, self.runs, self._left = safety, False, 0

    def _accept(self, server: socket.socket, talk: Callable[[socket.socket], None]) -> None:
        with suppress(OSError):
            while True:
                client, _ = server.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._serve, args=(client, talk), daemon=True).start()

    def _serve(self, client: socket.socket, talk: Callable[[socket.socket], None]) -> None:
        with client, suppress(OSError):
            talk(client)

    def _received(self, client: socket.socket, wait_s: float) -> Iterator[bytes]:
        """Yield what comes, and b"" whenever nothing came for so long."""
        while not self._end.is_set():
            data = b""
            if select.select([client], [], [], wait_s)[0]:
                data = client.recv(65536)
                if not data:
                    return
            yield data

    def _dashboard(self, client: socket.socket) -> None:
        client.sendall(b"Connected: Universal Robots Dashboard Server\n")
        answers = {
            "PolyscopeVersion": "URSoftware 5.12.2.1101534 (Mar 24 2022)",
            "get serial number": "20225500001",
            "is in remote control": str(self._remote).lower(),
        }
        text = ""
        for data in self._received(client, 0.05):
            *lines, text = (text + data.decode()).split("\n")
            for line in lines:
                told = {
                    "safetystatus": f"Safetystatus: {self.safety}",
                    "robotmode": f"Robotmode: {'RUNNING' if self.mode == 7 else 'POWER_OFF'}",
                    "programState": self.program,
                    "stop": "Stopped",
                }
                self.stopped += line == "stop"
                self.runs = self.runs and line != "stop"
                answer = {**answers, **told}.get(line, f'could not understand: "{line}"')
                client.sendall(answer.encode() + b"\n")

    def _script(self, client: socket.socket) -> None:
        text = ""
        for data in self._received(client, 0.05):
            text += data.decode("latin-1")
            if re.search(r"(?m)^end[ \t]*\r?\n", text):
                text, self.scripts = "", self.scripts + 1
                self.runs, self._executing, self.out_int = self.safety == "NORMAL", False, [1, 0, 0]

    def _rtde(self, client: socket.socket) -> None:
        rest, outputs, streaming = b"", (), False
        inputs: list[tuple[str, ...]] = []
        for data in self._received(client, 0.004):
            rest += data
            while len(rest) >= 3 and len(rest) >= HEADER.unpack_from(rest)[0]:
                size, number = HEADER.unpack_from(rest)
                kind, payload, rest = chr(number), rest[3:size], rest[size:]
                reply = {"V": b"\x01", "S": b"\x01", "v": struct.pack(">4I", 5, 12, 2, 0)}.get(kind)
                if kind == "O":
                    outputs = _names(payload[8:])
                    types = [
                        "NOT_FOUND" if name in self._lacks else OUTPUTS[name][0] for name in outputs
                    ]
                    reply = b"\x01" + ",".join(types).encode()
                elif kind == "I":
                    inputs.append(_names(payload))
                    types = ["IN_USE" if n == self._in_use else INPUTS[n] for n in inputs[-1]]
                    reply = bytes([len(inputs)]) + ",".join(types).encode()
                elif kind == "U":
                    self._write(inputs[payload[0] - 1], payload[1:])
                streaming = streaming or kind == "S"
                if reply is not None:
                    client.sendall(_package(kind, reply))
            with self._lock:
                self._turn()
            if streaming and not self.frozen:
                values = b"\x01"
                for name in outputs:
                    kind, get = OUTPUTS[name]
                    value = get(self)
                    code = f">{FORMATS[kind]}"
                    values += struct.pack(code, *(value if "VECTOR" in kind else (value,)))
                client.sendall(_package("U", values))

    def _write(self, names: tuple[str, ...], payload: bytes) -> None:
        if "external_force_torque" not in names:
            code = ">" + "".join(FORMATS[INPUTS[name]] for name in names)
            with self._lock:
                self._inputs.update(zip(names, struct.unpack(code, payload), strict=True))
                self._turn()

    def _turn(self) -> None:
        """Run one turn of the program's loop."""
        if not self.runs:
            return
        if self._left:
            ways = zip(self.pose, self._target, strict=True)
            self.pose = [a + (b - a) / self._left for a, b in ways]
            self._left -= 1
            self.out_int[2] = len(self.commands) % 128 << 24 | (1 << 15 if self._left else 0)
        command = int(self._inputs.get("input_int_register_0", 0))
        if command == STOP_SCRIPT:
            self.runs = False
        elif command == 0:
            self._executing, self.out_int[0] = False, 1
        elif not self._executing:
            self._carry_out(command)
            self._executing, self.out_int[0] = True, 2

    def _carry_out(self, command: int) -> None:
        self.commands.append(command)
        reals = [self._inputs.get(f"input_double_register_{k}", 0.0) for k in range(6)]
        if command in (MOVE_L, STOP_L):
            self._target, self._left = (reals if command == MOVE_L else self.pose), self.turns
            self.out_int[2] = len(self.commands) % 128 << 24 | 1 << 15
        elif command == SET_TCP:
            self.tcp = reals
        elif command == WATCHDOG:
            self.watchdog_hz = reals[0]
        elif command == SAFE_POSE:
            self.out_int[1] = 1


def _package(kind: str, payload: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload


def _names(payload: bytes) -> tuple[str, ...]:
    """Return comma-separated names; a comma at the end is allowed, as ur_rtde sends one."""
    return tuple(name.strip() for name in payload.decode().split(",") if name.strip())
