"""A line of G-code into words and modes, with the firmware's error numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

LONGEST = 79
"""Characters of a line, spaces and comments not counted (LINE_BUFFER_SIZE - 1)."""

LETTER, NUMBER, OVERFLOW = 1, 2, 11
UNSUPPORTED, MODAL, NO_FEED, NOT_WHOLE, TWO_AXIS, REPEATED, NO_AXES = 20, 21, 22, 23, 24, 25, 26
NO_VALUE, NOT_SUPPORTED_COORDINATES, AXES_UNUSED, TARGET, UNUSED = 28, 29, 31, 33, 36
NEGATIVE_VALUE, JOG_ONLY = 4, 16

_GROUPS = {
    "motion": ("G0", "G1", "G38.2", "G38.3", "G80"),
    "once": ("G4", "G10", "G53", "G92", "G92.1"),
    "plane": ("G17", "G18", "G19"),
    "distance": ("G90", "G91"),
    "rate": ("G94",),
    "units": ("G20", "G21"),
    "radius": ("G40",),
    "length": ("G49",),
    "system": ("G54", "G55", "G56", "G57", "G58", "G59"),
    "path": ("G61",),
    "program": ("M0", "M2", "M30"),
    "spindle": ("M3", "M4", "M5"),
    "coolant": ("M8", "M9"),
}
_GROUP_OF = {code: group for group, codes in _GROUPS.items() for code in codes}
_VALUES = "FIJKLNPRSTXYZ"
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")


class GcodeError(Exception):
    """number: what the firmware answers, ``error:N``."""

    def __init__(self, number: int) -> None:
        super().__init__(f"error:{number}")
        self.number = number


@dataclass(frozen=True)
class Words:
    """codes: mode by group. values: number by letter."""

    codes: dict[str, str] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)

    @property
    def axes(self) -> dict[int, float]:
        """Axis number -> value."""
        return {k: self.values[axis] for k, axis in enumerate("XYZ") if axis in self.values}


def plain(line: str) -> str:
    """Upper case, without spaces, comments and block deletes, as the firmware stores it."""
    line = re.sub(r"\([^)]*\)?|;.*", "", line)
    return "".join(c for c in line if c > " " and c != "/").upper()


def words(line: str) -> Words:
    """The words of a plain line. Raises GcodeError."""
    found = Words()
    at = 0
    while at < len(line):
        if not line[at].isalpha():
            raise GcodeError(LETTER)
        match = _WORD.match(line, at)
        if match is None:
            raise GcodeError(NUMBER)
        _take(found, match[1], match[2])
        at = match.end()
    return found


def _take(found: Words, letter: str, number: str) -> None:
    value = float(number)
    if letter in "GM":
        code = f"{letter}{value:g}"
        group = _GROUP_OF.get(code)
        if group is None:
            raise GcodeError(UNSUPPORTED)
        if group in found.codes:
            raise GcodeError(MODAL)
        found.codes[group] = code
        return
    if letter not in _VALUES:
        raise GcodeError(UNSUPPORTED)
    if letter in found.values:
        raise GcodeError(REPEATED)
    if letter in "FNPTS" and value < 0:
        raise GcodeError(NEGATIVE_VALUE)
    found.values[letter] = value
