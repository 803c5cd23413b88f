"""Lines of G-code as GRBL 1.1h reads and writes them."""

from __future__ import annotations

import re

from tactibench_tactip.emulators.motion import Array

STATEMENT, HOMING_OFF, NOT_IDLE, NO_G_CODE, JOG_TRAVEL, UNSUPPORTED = 3, 5, 8, 9, 15, 20
"""Numbers of GRBL's errors."""
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")


class GcodeError(Exception):
    """A line that is answered with ``error:N``; N is the only argument."""


def parse_words(text: str) -> tuple[set[str], dict[str, float]]:
    """Return the G codes of a line, and its other numbers by letter.

    Raises:
        GcodeError: The line holds other words than G, F, X, Y and Z, or repeats a word.
    """
    words = _WORD.findall(text)
    codes = {f"G{float(number):g}" for letter, number in words if letter == "G"}
    values = {letter: float(number) for letter, number in words if letter in "FXYZ"}
    read = "".join(letter + number for letter, number in words)
    if read != text or len(codes) + len(values) != len(words):
        raise GcodeError(UNSUPPORTED)
    return codes, values


def format_axes(values: Array) -> str:
    """Return ``x,y,z`` with three decimals and without a minus zero."""
    return ",".join(f"{round(float(value), 3) + 0.0:.3f}" for value in values)
