"""A stage with GRBL on a pseudo-terminal, for the driver that is under test.

Its parser, its states and its answers are those of the published protocol (GRBL 1.1, wiki pages
"Interface" and "Commands"; grblHAL, "Changes from grbl 1.1"; FluidNC, "Settings"), as far as a
driver can see them. It goes a third of its way between two status reports, so that a test does not
wait for it. The tool is where it is, whatever the controller believes: a reset moves nothing.
"""

from __future__ import annotations

import os
import re
import select
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Self

SETTINGS = {
    "$10": "1",
    "$13": "0",
    **dict.fromkeys(("$20", "$21", "$22"), "1"),
    **dict.fromkeys(("$110", "$111", "$112"), "6000.000"),
    **dict.fromkeys(("$130", "$131", "$132"), "200.000"),
}
Place = tuple[float, float, float]
HOME: Place = (-1.0, -1.0, -1.0)


@dataclass(frozen=True)
class Firmware:
    """What a firmware says of itself, and whether it starts locked where it homes."""

    banner: str = "Grbl 1.1h ['$' for help]"
    version: tuple[str, ...] = ("[VER:1.1h.20190830:]", "[OPT:V,15,128]")
    settings: dict[str, str] = field(default_factory=dict)
    lacks: tuple[str, ...] = ()
    locks: bool = True


GRBL = Firmware()
GRBL_09 = Firmware(settings={"$13": "0 (report inches, bool)", "$22": "1 (homing cycle, bool)"})
GRBL_HAL = Firmware(
    "GrblHAL 1.1f ['$' or '$HELP' for help]",
    ("[VER:1.1f.20250101:]", "[OPT:VNMGHL,35,1024,3,0]", "[FIRMWARE:grblHAL]"),
    {"$22": "11"},  # homes, single axes, from anywhere; bit 2 is not set: it starts unlocked
    locks=False,
)
FLUID_NC = Firmware(
    "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
    ("[VER:3.7 FluidNC v3.7.8:]", "[OPT:MPHS]"),
    lacks=("$13",),
)
WORK_POSITIONS = Firmware(settings={"$10": "0"})


class ScriptedGrbl:
    """A stage.

    Attributes:
        address: Name of its port.
        state: State of its reports.
        tool: Place of the tool.
        homes: Whether ``$H`` is answered.
        mute: Whether it goes on and says nothing.
        offset: Offset of work positions, which every tenth report tells.
        piece: Number of characters that it sends at a time; 0: whole lines.
        at_way: Called when a move begins.
        begun: Begin of a line whose end has not come yet.
        reset_at: Number of the received byte after which it starts anew; 0: none.
        lines: All lines that it got.
        realtime: All characters that it acted on at once, without ``?``.
        ways: All moves, as places from and to of the tool.
    """

    def __init__(
        self, settings: dict[str, str] | None = None, firmware: Firmware = GRBL, state: str = ""
    ) -> None:
        told = {**SETTINGS, **firmware.settings, **(settings or {})}
        self.settings = {name: v for name, v in told.items() if name not in firmware.lacks}
        self.firmware, self.homes, self.mute = firmware, True, False
        self.tool = self._target = (-50.0, -50.0, -50.0)
        self._error: Place = (0.0, 0.0, 0.0)  # of what the controller believes
        self.offset: Place = (8.0, 0.0, 0.0)
        self.reset_at = self._received = self._reports = self._left = 0
        self.piece = 0
        self.at_way: Callable[[], None] = lambda: None
        self.lines: list[str] = []
        self.ways: list[tuple[Place, Place]] = []
        self.realtime = self.begun = b""
        self._modes = {"G90": True, "F": 0.0}
        self.state = state or ("Alarm" if self._locks() else "Idle")
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
        data = b"" if self.mute else line.encode() + b"\r\n"
        size = self.piece or len(data) or 1
        for start in range(0, len(data), size):
            os.write(self._master, data[start : start + size])
            if self.piece:
                time.sleep(0.0002)

    def start_anew(self, banner: str = "") -> None:
        """Lose power for a moment: the tool stays, what the controller knew is gone."""
        self._move(share=0.5)  # it stops on its way
        self._error, self._left, self._target = self.tool, 0, self.tool
        self._modes = {"G90": True, "F": 0.0}
        self.state, self._reports = "Alarm" if self._locks() else "Idle", 0
        self.say("")
        self.say(banner or self.firmware.banner)

    def _locks(self) -> bool:
        return self.firmware.locks and int(self.settings.get("$22", "1").split()[0]) & 1 == 1

    def _serve(self) -> None:
        greeted = False
        while not self._end.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                if not greeted:  # a client that opens the port drops what was there
                    self.say(self.firmware.banner)
                continue
            with suppress(OSError):
                for byte in os.read(self._master, 4096):
                    greeted = True
                    self._received += 1
                    if byte in b"?!~\x18" or byte >= 0x80:
                        self._act(bytes([byte]))
                    elif byte == ord("\n"):
                        line, self.begun = self.begun.decode(), b""
                        self._answer(line)
                    else:
                        self.begun += bytes([byte])
                    if self._received == self.reset_at:
                        self.begun = b""
                        self.start_anew()

    def _act(self, byte: bytes) -> None:
        if byte == b"?":
            self._report()
            return
        self.realtime += byte
        if byte == b"\x85" and self.state == "Jog":
            self._target, self._left, self.state = self.tool, 0, "Idle"
        elif byte == b"\x18":  # it keeps its position, unless it moved
            self._modes = {"G90": True, "F": 0.0}
            self.say(self.firmware.banner)

    def _move(self, share: float) -> None:
        if self._left:
            ways = zip(self.tool, self._target, strict=True)
            self.tool = tuple(a + share * (b - a) for a, b in ways)  # type: ignore[assignment]

    def _report(self) -> None:
        if self.state in ("Jog", "Run"):
            self._move(1.0 / self._left)
            self._left -= 1
            self.state = self.state if self._left else "Idle"
        if self.state == "Home":
            return
        place = tuple(a - b for a, b in zip(self.tool, self._error, strict=True))
        name, extra = "MPos", ""
        if self.settings.get("$10") == "0":
            place = tuple(a - b for a, b in zip(place, self.offset, strict=True))
            name = "WPos"
            if self._reports % 10 == 9:
                extra = "|WCO:" + ",".join(f"{v:.3f}" for v in self.offset)
        self._reports += 1
        self.say(f"<{self.state}|{name}:{','.join(f'{v:.3f}' for v in place)}|FS:0,0{extra}>")

    def _answer(self, line: str) -> None:
        self.lines.append(line)
        if line == "$H":
            if not int(self.settings.get("$22", "1").split()[0]) & 1:
                self.say("error:5")
                return
            self.state = "Home"
            if not self.homes:
                return
            self.tool, self._error, self.state = HOME, (0.0, 0.0, 0.0), "Idle"
        elif line == "$$":
            for name, value in self.settings.items():
                self.say(f"{name}={value}")
        elif line == "$I":
            for answer in self.firmware.version:
                self.say(answer)
        elif line == "$":
            self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
        elif line == "$G":
            mode = "G90" if self._modes["G90"] else "G91"
            self.say(f"[GC:G0 G54 G17 G21 {mode} G94 M5 M9 T0 F{self._modes['F']:.0f} S0]")
        elif line == "$X":
            self.state = "Idle" if self.state == "Alarm" else self.state
        elif line:
            error = self._run(line)
            if error:
                self.say(f"error:{error}")
                return
        self.say("ok")

    def _run(self, line: str) -> int:
        """Run G-code, of a jog or of a line that lost its head, and return GRBL's error."""
        jogs = line.startswith("$J=")
        words = re.findall(r"([A-Z])(-?[\d.]+)", line.removeprefix("$J="))
        if "".join(a + b for a, b in words) != line.removeprefix("$J="):
            return 1
        if self.state == "Alarm":
            return 9
        values = dict(words)
        modes = [v for k, v in words if k == "G" and v in ("90", "91")]
        absolute = modes[-1] == "90" if modes else bool(self._modes["G90"])
        if not jogs:
            self._modes = {"G90": absolute, "F": float(values.get("F", self._modes["F"]))}
        ways = [float(values.get(axis, 0.0 if not absolute else "nan")) for axis in "XYZ"]
        if not any(axis in values for axis in "XYZ"):
            return 0
        here = [a - b for a, b in zip(self.tool, self._error, strict=True)]
        if not absolute:
            there = [a + b for a, b in zip(here, ways, strict=True)]
        else:
            there = [b if b == b else a for a, b in zip(here, ways, strict=True)]
        if self.settings.get("$20") == "1" and max(there) > 0.0:
            return 15
        x, y, z = (a + b for a, b in zip(there, self._error, strict=True))
        self._target, self._left, self.state = (x, y, z), 3, "Jog" if jogs else "Run"
        self.ways.append((self.tool, self._target))
        self.at_way()
        if self.mute:
            self._move(1.0)
        return 0
