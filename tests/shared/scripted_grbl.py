"""A stage with GRBL 1.1h on a pseudo-terminal, for the driver that is under test.

It goes a third of its way between two status reports, so that a test does not wait for it.
"""

from __future__ import annotations

import os
import re
import select
import threading
import tty
from contextlib import suppress
from typing import Self

BANNER = "Grbl 1.1h ['$' for help]"
SETTINGS = {
    "$13": 0,
    **dict.fromkeys(("$20", "$21", "$22"), 1),
    **dict.fromkeys(("$110", "$111", "$112"), 6000),
    **dict.fromkeys(("$130", "$131", "$132"), 200),
}
MEANINGS = {"$I": ["[VER:1.1h.20190830:]"], "$G": ["[GC:G1 G21 G90]"]}


class ScriptedGrbl:
    """A stage; settings: those that differ from SETTINGS.

    Attributes:
        address: Name of its port.
        state: State of its reports.
        place: Position of the machine, mm.
        homes: Whether ``$H`` is answered.
        lines: All lines that it got.
        realtime: All characters that it acted on at once, without ``?``.
    """

    def __init__(self, settings: dict[str, float] | None = None, state: str = "Alarm") -> None:
        self.settings = {**SETTINGS, **(settings or {})}
        self.state, self.homes = state, True
        self.place = self._target = (-50.0, -50.0, -50.0)
        self._left = 0
        self.lines: list[str] = []
        self.realtime = b""
        self._end = threading.Event()
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.address = os.ttyname(slave)
        self._slave = slave  # held open: the port stays when a client closes it
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(5.0)
        for number in (self._master, self._slave):
            os.close(number)

    def say(self, line: str) -> None:
        """Send a line, such as an alarm."""
        os.write(self._master, line.encode() + b"\r\n")

    def _serve(self) -> None:
        text, greeted = b"", False
        while not self._end.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                if not greeted:  # a client that opens the port drops what was there
                    self.say(BANNER)
                continue
            with suppress(OSError):
                for byte in os.read(self._master, 4096):
                    greeted = True
                    if byte in b"?!~\x18" or byte >= 0x80:
                        self._act(bytes([byte]))
                    elif byte == ord("\n"):
                        self._answer(text.decode())
                        text = b""
                    else:
                        text += bytes([byte])

    def _act(self, byte: bytes) -> None:
        if byte == b"?":
            self._report()
            return
        self.realtime += byte
        if byte == b"\x85":
            self._target, self._left = self.place, 0
            self.state = "Idle"
        elif byte == b"\x18":
            self.state = "Alarm"
            self.say(BANNER)

    def _report(self) -> None:
        if self.state == "Jog":
            ways = zip(self.place, self._target, strict=True)
            self.place = tuple(a + (b - a) / self._left for a, b in ways)  # type: ignore[assignment]
            self._left -= 1
            self.state = "Jog" if self._left else "Idle"
        if self.state != "Home":
            self.say(f"<{self.state}|MPos:{','.join(f'{v:.3f}' for v in self.place)}|FS:0,0>")

    def _answer(self, line: str) -> None:
        self.lines.append(line)
        if line == "$H":
            self.state = "Home"
            if not self.homes:
                return
            self.place, self.state = (-1.0, -1.0, -1.0), "Idle"
        elif line == "$$":
            for name, value in self.settings.items():
                self.say(f"{name}={value}")
        elif line.startswith("$J="):
            x, y, z = (float(v) for v in re.findall(r"[XYZ](-?[\d.]+)", line))
            if max(x, y, z) > 0.0:
                self.say("error:15")
                return
            self._target, self._left, self.state = (x, y, z), 3, "Jog"
        for answer in MEANINGS.get(line, ()):
            self.say(answer)
        self.say("ok")
