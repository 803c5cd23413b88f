"""The safety status of a UR in words; bits as in the RTDE guide."""

from __future__ import annotations

NORMAL, REDUCED, PROTECTIVE = 0, 1, 2
_BITS = {
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "emergency stop of the system",
    6: "emergency stop of the robot",
    7: "emergency stop",
    8: "safety violation",
    9: "safety fault",
    11: "three-position switch active",
}
_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "safety has to be confirmed",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle, brakes on",
    6: "backdrive",
    7: "running",
}


def normal(bits: int) -> bool:
    """Whether it may be moved: normal or reduced, and nothing else set."""
    return bool(bits & 0b11) and not any(bits >> bit & 1 for bit in _BITS)


def protective(bits: int) -> bool:
    """Whether a protective stop is all that is wrong."""
    others = [bit for bit in _BITS if bit != PROTECTIVE and bits >> bit & 1]
    return bool(bits >> PROTECTIVE & 1) and not others


def safety_words(bits: int, mode: int) -> str:
    """Everything that keeps it from moving; its mode when nothing does."""
    found = [word for bit, word in _BITS.items() if bits >> bit & 1]
    if mode != 7:
        found.append(_MODES.get(mode, f"robot mode {mode}"))
    return ", ".join(found) or ("reduced" if bits >> REDUCED & 1 else "normal")
