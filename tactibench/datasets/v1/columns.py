"""Types of what a sample carries in ``extra``: a key that changes its type breaks readers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tactibench.errors import UserError

Kind = str | dict[str, "Kind"] | list["Kind"] | None
"""Name of a type, the kinds of an object's keys, the kind of a list's values; None: null only."""


def kind_of(value: Any) -> Kind:
    """The kind of a JSON value. Raises UserError for a list of several kinds, or no JSON."""
    if value is None:
        return None
    for scalar in (bool, int, float, str):  # a bool is an int, so it comes first
        if isinstance(value, scalar):
            return scalar.__name__
    if isinstance(value, Mapping):
        return {str(key): kind_of(item) for key, item in value.items()}
    if isinstance(value, Sequence):
        kind: Kind = None
        for item in value:
            kind = joined(kind, kind_of(item), "a list")
        return [kind]
    raise UserError(f"{value!r} is no JSON value; write text, numbers, lists and objects.")


def joined(before: Kind, now: Kind, where: str) -> Kind:
    """What both are; null is of every kind, and keys may be left out. Raises UserError."""
    if before is None or now is None or before == now:
        return now if before is None else before
    if isinstance(before, dict) and isinstance(now, dict):
        keys = {**before, **now}
        return {key: joined(before.get(key), now.get(key), f"{where}.{key}") for key in keys}
    if isinstance(before, list) and isinstance(now, list):
        return [joined(before[0], now[0], where)]
    raise UserError(
        f"{where} holds {_word(now)} after {_word(before)}; a key has one type in all samples "
        "(write 1.0 rather than 1 where others are 0.5)."
    )


def _word(kind: Kind) -> str:
    if isinstance(kind, dict):
        return "an object"
    return "a list" if isinstance(kind, list) else str(kind)
