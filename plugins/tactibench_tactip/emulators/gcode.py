"""The language of GRBL 1.1h: settings, words of a line, numbers of errors."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from tactibench import UserError
from tactibench_tactip.emulators.motion import Array

LETTER, NUMBER, STATEMENT, HOMING_OFF, NOT_IDLE, NO_G_CODE, OVERFLOW = 1, 2, 3, 5, 8, 9, 11
JOG_TRAVEL, JOG_WORDS, UNSUPPORTED, NO_FEED, REPEATED, NO_AXES, TARGET = 15, 16, 20, 22, 25, 26, 33

_DEFAULTS = (
    "$0=10 $1=25 $2=0 $3=0 $4=0 $5=0 $6=0 $10=1 $11=0.010 $12=0.002 $13=0 $20=1 $21=1 $22=1 $23=0 "
    "$24=25.000 $25=500.000 $26=250 $27=1.000 $30=1000 $31=0 $32=0 "
    "$100=250.000 $101=250.000 $102=250.000 $110=3000.000 $111=3000.000 $112=3000.000 "
    "$120=500.000 $121=500.000 $122=500.000 $130=200.000 $131=200.000 $132=200.000"
)
"""Settings of a small stage: homing and limits on, 50 mm/s, 500 mm/s2, travel 200 mm."""
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")


class GcodeError(Exception):
    """A line that is answered with ``error:number``."""

    def __init__(self, number: int) -> None:
        super().__init__(f"error:{number}")
        self.number = number


class Settings:
    """The settings by name, in the units of GRBL's documentation (mm, s, mm/min)."""

    def __init__(self, given: Mapping[str, float] | None = None) -> None:
        self._texts = dict(item.split("=") for item in _DEFAULTS.split())
        for name, value in (given or {}).items():
            if name not in self._texts:
                known = ", ".join(self._texts)
                raise UserError(f"GRBL 1.1 has no setting {name!r}; known are {known}.")
            self._texts[name] = f"{value:.3f}" if "." in self._texts[name] else f"{value:.0f}"

    def __getitem__(self, name: str) -> float:
        return float(self._texts[name])

    def axes(self, first: int) -> Array:
        """Return x, y, z of a group such as 110."""
        return np.array([self[f"${first + k}"] for k in range(3)])

    def lines(self) -> list[str]:
        """Return the lines that ``$$`` prints."""
        return [f"{name}={text}" for name, text in self._texts.items()]


def parse_words(text: str) -> tuple[set[str], dict[str, float]]:
    """Return the G codes of a line, and its numbers by letter. Raises GcodeError."""
    codes: set[str] = set()
    values: dict[str, float] = {}
    at = 0
    while at < len(text):
        if not text[at].isalpha():
            raise GcodeError(LETTER)
        match = _WORD.match(text, at)
        if match is None:
            raise GcodeError(NUMBER)
        letter, number, at = match[1], float(match[2]), match.end()
        if letter == "G":
            codes.add(f"G{number:g}")
        elif letter in values:
            raise GcodeError(REPEATED)
        elif letter in "FXYZ":
            values[letter] = number
        else:
            raise GcodeError(UNSUPPORTED)
    return codes, values
