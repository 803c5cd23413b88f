"""One RTDE connection: what it asked for, and the packages that answer."""

from __future__ import annotations

import struct
from typing import Protocol

from tactibench_tactip.emulators.ur import wire
from tactibench_tactip.emulators.ur.controller import Controller
from tactibench_tactip.emulators.ur.fields import INPUTS, OUTPUTS

MOST_HZ, MOST_HZ_CB3 = 500.0, 125.0


class Registers(Protocol):
    """Who writes which input: a field belongs to one connection at a time."""

    def taken(self, name: str, by: object) -> bool:
        """Whether somebody else writes it."""
        ...

    def take(self, name: str, by: object) -> None: ...


class RtdeSession:
    """Bytes of the client by ``feed``, data packages by ``sample``."""

    def __init__(self, controller: Controller, registers: Registers) -> None:
        self._controller, self._registers = controller, registers
        self._splitter = wire.Splitter()
        self._version = 1
        self._recipe = 0
        self._outputs: tuple[str, ...] = ()
        self._inputs: list[tuple[str, ...]] = []
        self.hertz = MOST_HZ_CB3
        self.streaming = False

    def feed(self, data: bytes, t: float) -> bytes:
        """Answers to what came, in any portions. Raises ValueError where it is no RTDE."""
        out = b""
        for kind, payload in self._splitter.feed(data):
            try:
                out += self._answer(kind, payload, t)
            except (struct.error, UnicodeDecodeError) as error:
                raise ValueError(f"a package of type {kind} cannot be read: {error}") from None
        return out

    def sample(self, wrong_by: int = 0) -> bytes:
        """A data package of this moment. wrong_by: added to its length by a fault."""
        types = [OUTPUTS[name][0] for name in self._outputs]
        values = [OUTPUTS[name][1](self._controller) for name in self._outputs]
        data = wire.pack_values(types, values)
        number = bytes([self._recipe]) if self._version > 1 else b""
        return wire.packed(wire.DATA, number + data, wrong_by=wrong_by)

    def _answer(self, kind: int, payload: bytes, t: float) -> bytes:
        if kind == wire.VERSION:
            (wanted,) = struct.unpack(">H", payload)
            accepted = wanted in {1, 2}
            self._version = wanted if accepted else self._version
            return wire.packed(kind, bytes([accepted]))
        if kind == wire.URCONTROL:
            return wire.packed(kind, struct.pack(">4I", *self._controller.version))
        if kind == wire.OUTPUTS:
            return wire.packed(kind, self._set_outputs(payload))
        if kind == wire.INPUTS:
            return wire.packed(kind, self._set_inputs(payload))
        if kind in {wire.START, wire.PAUSE}:
            possible = kind == wire.PAUSE or bool(self._outputs)
            self.streaming = kind == wire.START and possible
            return wire.packed(kind, bytes([possible]))
        if kind == wire.DATA:
            self._write(payload, t)
            return b""
        if kind == wire.TEXT:
            self._controller.messages.append(payload.decode("latin-1"))
            return b""
        return wire.text_message(self._version, f"unknown package type {kind}", level=1)

    def _set_outputs(self, payload: bytes) -> bytes:
        wanted = MOST_HZ_CB3
        if self._version > 1:
            (wanted,) = struct.unpack_from(">d", payload)
            payload = payload[8:]
        most = MOST_HZ_CB3 if self._controller.is_cb3 else MOST_HZ
        names = _names(payload)
        types = [OUTPUTS[n][0] if n in OUTPUTS else wire.NOT_FOUND for n in names]
        if wire.NOT_FOUND not in types:
            self._outputs, self._recipe = names, self._recipe % 255 + 1
            self.hertz = min(max(wanted, 1.0), most)
        number = bytes([self._recipe]) if self._version > 1 else b""
        return number + ",".join(types).encode()

    def _set_inputs(self, payload: bytes) -> bytes:
        names = _names(payload)
        types = [INPUTS.get(name, wire.NOT_FOUND) for name in names]
        types = [
            wire.IN_USE if self._registers.taken(name, self) else kind
            for name, kind in zip(names, types, strict=True)
        ]
        number = 0
        if not {wire.NOT_FOUND, wire.IN_USE} & set(types):
            self._inputs.append(names)
            number = len(self._inputs)
            for name in names:
                self._registers.take(name, self)
        return bytes([number]) + ",".join(types).encode()

    def _write(self, payload: bytes, t: float) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self._inputs):
            raise ValueError(f"a data package names input recipe {number}, which there is not")
        names = self._inputs[number - 1]
        values = wire.unpack_values([INPUTS[name] for name in names], payload[1:])
        self._controller.inputs.update(zip(names, values, strict=True))
        self._controller.written(names, t)


def _names(payload: bytes) -> tuple[str, ...]:
    """Comma-separated; a comma at the end is allowed, as ur_rtde sends one."""
    if len(payload) > wire.LONGEST_NAMES:
        raise ValueError(f"a list of names has {len(payload)} bytes, at most 2048 are allowed")
    return tuple(name.strip() for name in payload.decode().split(",") if name.strip())
