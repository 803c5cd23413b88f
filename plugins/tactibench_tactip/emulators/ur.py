"""The servers of a UR controller: RTDE, script and dashboard.

RTDE as in UR's guide "Real-Time Data Exchange", protocol version 2, everything big-endian; the
dashboard as in "Dashboard Server e-Series".
"""

from __future__ import annotations

import math
import re
import select
import socket
import struct
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from tactibench import UserError
from tactibench_tactip.emulators.device import IDLE_S, Device, Fault
from tactibench_tactip.emulators.motion import Pose6
from tactibench_tactip.emulators.ur_controller import RUNNING, Controller
from tactibench_tactip.emulators.world import World

RTDE, SCRIPT, DASHBOARD = 30004, 30003, 29999
TICK_S = 0.005
"""Host seconds between two turns of the program; an RTDE client makes it turn in between."""
MOST_HZ = 500.0
SCRIPT_END = re.compile(r"(?m)^end[ \t]*\r?\n")
CONTROL_VERSION = (5, 12, 2, 1101534)
POLYSCOPE = "URSoftware 5.12.2.1101534 (Mar 24 2022)"
SERIAL = "20225500001"
REFUSED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective "
    "stop before unlocking"
)


def _out_double(number: int, controller: Controller) -> float:
    return controller.out_double[number]


OUTPUTS: dict[str, tuple[str, Callable[[Controller], Any]]] = {
    "timestamp": ("DOUBLE", lambda c: c.t),
    "actual_TCP_pose": ("VECTOR6D", lambda c: c.pose()),
    "actual_TCP_force": ("VECTOR6D", lambda c: c.force()),
    "robot_mode": ("INT32", lambda c: c.robot_mode),
    "safety_mode": ("INT32", lambda c: c.safety_mode),
    "runtime_state": ("UINT32", lambda c: c.runtime_state),
    "robot_status_bits": ("UINT32", lambda c: c.status_bits),
    "safety_status_bits": ("UINT32", lambda c: c.safety_bits),
    "output_int_register_0": ("INT32", lambda c: c.out_int[0]),
    "output_int_register_1": ("INT32", lambda c: c.out_int[1]),
    "output_int_register_2": ("INT32", lambda c: c.out_int[2]),
    "target_speed_fraction": ("DOUBLE", lambda c: c.slider),
    **{f"output_double_register_{k}": ("DOUBLE", partial(_out_double, k)) for k in range(6)},
}
"""Field that ur_rtde asks for -> its type, and the function that returns its value."""
INPUTS = {
    **{f"input_int_register_{k}": "INT32" for k in range(8)},
    **{f"input_double_register_{k}": "DOUBLE" for k in range(18)},
    "external_force_torque": "VECTOR6D",
}
FORMATS = {"UINT32": "I", "INT32": "i", "DOUBLE": "d", "VECTOR6D": "6d"}
HEADER = struct.Struct(">HB")


def package(kind: str, payload: bytes, wrong_by: int = 0) -> bytes:
    """Return an RTDE package.

    Args:
        kind: Letter of the package's type.
        payload: Bytes after the header.
        wrong_by: Number that a fault adds to the length in the header.
    """
    return HEADER.pack(HEADER.size + len(payload) + wrong_by, ord(kind)) + payload


def split_packages(data: bytes) -> tuple[list[tuple[str, bytes]], bytes]:
    """Return (kind, payload) of the complete packages of a stream, and the bytes that are left.

    Raises:
        ValueError: A package gives a length shorter than its header.
    """
    packages = []
    while len(data) >= HEADER.size:
        size, kind = HEADER.unpack_from(data)
        if size < HEADER.size:
            raise ValueError(f"a package of {size} bytes is shorter than its header")
        if len(data) < size:
            break
        packages.append((chr(kind), data[HEADER.size : size]))
        data = data[size:]
    return packages, data


class RtdeSession:
    """One RTDE connection: the fields that it asked for, and the packages that answer.

    Args:
        controller: State of the robot.
        in_use: Input fields that a fieldbus holds.
    """

    def __init__(self, controller: Controller, in_use: tuple[str, ...]) -> None:
        self._controller, self._in_use = controller, in_use
        self._rest = b""
        self._outputs: tuple[str, ...] = ()
        self._inputs: list[tuple[str, ...]] = []
        self.hertz, self.streaming = 125.0, False

    def feed(self, data: bytes, t: float) -> bytes:
        """Return the answers to bytes that come in portions of any size.

        Args:
            data: The next portion.
            t: Time of the world, s.

        Raises:
            ValueError: A package is no RTDE, or of a type that is not emulated.
        """
        packages, self._rest = split_packages(self._rest + data)
        try:
            return b"".join(self._answer(kind, payload, t) for kind, payload in packages)
        except (struct.error, UnicodeDecodeError) as error:
            raise ValueError(f"a package cannot be read: {error}") from None

    def sample(self, wrong_by: int = 0) -> bytes:
        """Return a data package of this moment.

        Args:
            wrong_by: Number that a fault adds to the length in the header.
        """
        data = b"\x01"
        for name in self._outputs:
            kind, get = OUTPUTS[name]
            value = get(self._controller)
            data += struct.pack(f">{FORMATS[kind]}", *(value if kind == "VECTOR6D" else (value,)))
        return package("U", data, wrong_by)

    def _answer(self, kind: str, payload: bytes, t: float) -> bytes:
        if kind == "V":
            return package(kind, bytes([payload == b"\x00\x02"]))
        if kind == "v":
            return package(kind, struct.pack(">4I", *CONTROL_VERSION))
        if kind == "O":
            return package(kind, b"\x01" + self._set_outputs(payload))
        if kind == "I":
            return package(kind, self._set_inputs(payload))
        if kind == "S":
            self.streaming = bool(self._outputs)
            return package(kind, bytes([self.streaming]))
        if kind == "U":
            self._write(payload, t)
            return b""
        raise ValueError(f"packages of type {kind!r} are not emulated")

    def _set_outputs(self, payload: bytes) -> bytes:
        (hertz,) = struct.unpack_from(">d", payload)
        names = _names(payload[8:])
        types = [OUTPUTS[name][0] if name in OUTPUTS else "NOT_FOUND" for name in names]
        if "NOT_FOUND" not in types:
            self._outputs, self.hertz = names, min(max(hertz, 1.0), MOST_HZ)
        return ",".join(types).encode()

    def _set_inputs(self, payload: bytes) -> bytes:
        names = _names(payload)
        types = [
            "IN_USE" if name in self._in_use else INPUTS.get(name, "NOT_FOUND") for name in names
        ]
        number = 0
        if not {"NOT_FOUND", "IN_USE"} & set(types):
            self._inputs.append(names)
            number = len(self._inputs)
        return bytes([number]) + ",".join(types).encode()

    def _write(self, payload: bytes, t: float) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self._inputs):
            raise ValueError(f"a data package names input recipe {number}, which there is not")
        names = self._inputs[number - 1]
        code = ">" + "".join(FORMATS[INPUTS[name]] for name in names)
        values = struct.unpack(code, payload[1:])
        if "external_force_torque" not in names:
            self._controller.inputs.update(zip(names, values, strict=True))
        self._controller.written(names, t)


def dashboard_answer(controller: Controller, line: str, t: float) -> str:
    """Return the dashboard's answer to one line, at ``t`` s of the world."""
    answers = {
        "polyscopeversion": POLYSCOPE,
        "get serial number": SERIAL,
        "is in remote control": str(controller.remote).lower(),
        "safetystatus": f"Safetystatus: {controller.safety}",
        "robotmode": f"Robotmode: {'RUNNING' if controller.robot_mode == RUNNING else 'POWER_OFF'}",
        "close safety popup": "closing safety popup",
    }
    command = line.strip().lower()
    if command in answers:
        return answers[command]
    if command not in {"stop", "unlock protective stop"}:
        return f'could not understand: "{line}"'
    if not controller.remote:
        return "Command is not allowed in local control mode"
    if command == "stop":
        controller.end_program(t)
        return "Stopped"
    return "Protective stop releasing" if controller.unlock(t) else REFUSED


class UrEmulator(Device):
    """A UR controller on a loopback address of its own (ports 30004, 30003, 29999).

    ur_rtde keeps Python's lock while it waits, so the client must live in another process.

    Args:
        world: The world in which the arm moves.
        host: Loopback address.
        tool: True place of the world's tool point on the flange, mm and deg.
        in_use: Input fields that a fieldbus holds, such as "input_int_register_0".
        controller: Further arguments of ``Controller``.
    """

    def __init__(
        self,
        world: World,
        host: str = "127.0.0.2",
        *,
        tool: Pose6 = (0.0, 0.0, 89.1, 0.0, 0.0, 0.0),
        in_use: tuple[str, ...] = (),
        **controller: Any,
    ) -> None:
        super().__init__()
        self.world, self.host = world, host
        self.controller = Controller(world, tool, **controller)
        self._in_use = in_use
        self._frozen_until, self._wrong_by = -math.inf, 0
        world.on_fault(
            {
                "protective-stop": lambda _, t: self.controller.protective_stop(t),
                "emergency-stop": lambda _, t: self.controller.emergency_stop(t),
                "program-stop": lambda _, t: self.controller.end_program(t),
                "socket-drop": lambda _, __: self.hang_up(RTDE, SCRIPT),
                "unlock-refused": lambda fault, _: self.controller.refuse_unlocks(fault.amount),
                "frozen-stream": self._freeze,
                "wrong-length": self._spoil_length,
            }
        )

    def start(self) -> None:
        """Listen on the ports of the controller.

        Raises:
            UserError: A port cannot be opened, for instance because it is taken.
        """
        talks = {RTDE: self._talk_rtde, SCRIPT: self._take_scripts, DASHBOARD: self._talk_dashboard}
        try:
            for port, talk in talks.items():
                self.listen(self.host, port, talk)
        except OSError as error:
            self.stop()
            raise UserError(
                f"port {port} of {self.host} cannot be opened ({error.strerror}); another emulator "
                "may be on it: take another address, such as 127.0.0.3."
            ) from None
        self.run("ur", self._run_program)

    def _run_program(self) -> None:
        while not self.stopping.wait(TICK_S):
            with self.world.lock:
                self.controller.step(self.world.advance())

    def _talk_rtde(self, client: socket.socket) -> None:
        session = RtdeSession(self.controller, self._in_use)
        due = time.monotonic()
        while not self.stopping.is_set():
            wait = max(0.0, due - time.monotonic()) if session.streaming else IDLE_S
            out = b""
            readable = bool(select.select([client], [], [], wait)[0])
            data = client.recv(65536) if readable else b""
            if readable and not data:
                return
            with self.world.lock:
                t = self.world.advance()
                out += session.feed(data, t)
                self.controller.step(t)
                if session.streaming and time.monotonic() >= due:
                    due = max(due + 1 / session.hertz, time.monotonic())
                    if t >= self._frozen_until:
                        out += session.sample(self._wrong_by)
                        self._wrong_by = 0
            client.sendall(out)

    def _take_scripts(self, client: socket.socket) -> None:
        text = ""
        for data in self.received(client):
            text += data.decode("latin-1")
            while (end := SCRIPT_END.search(text)) is not None:
                with self.world.lock:
                    self.controller.load(text[: end.end()], self.world.advance())
                text = text[end.end() :]

    def _talk_dashboard(self, client: socket.socket) -> None:
        client.sendall(b"Connected: Universal Robots Dashboard Server\n")
        text = ""
        for data in self.received(client):
            *lines, text = (text + data.decode("latin-1")).split("\n")
            for line in lines:
                with self.world.lock:
                    answer = dashboard_answer(self.controller, line, self.world.advance())
                client.sendall(answer.encode() + b"\n")

    def _freeze(self, fault: Fault, t: float) -> None:
        self._frozen_until = t + fault.amount

    def _spoil_length(self, fault: Fault, _: float) -> None:
        self._wrong_by = int(fault.amount)


def _names(payload: bytes) -> tuple[str, ...]:
    """Return comma-separated names; a comma at the end is allowed, as ur_rtde sends one."""
    return tuple(name.strip() for name in payload.decode().split(",") if name.strip())
