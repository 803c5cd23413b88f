"""Code blocks of a page: what is typed, what is shown, and whether what was printed agrees."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

GAP = "..."
SLOW = "<!-- slow -->"
_BLOCK = re.compile(rf"^(?P<slow>{SLOW}\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
_HASH = re.compile(r"\b[0-9a-f]{8,}\b")
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
_TIMED = re.compile(r"\b(ms|s|min|MB|frames/s|threads?)\b")
TOLERANCE = 0.05
"""Shown and printed figures agree within this share; times need not agree at all."""


@dataclass(frozen=True)
class Block:
    """A fenced block. language: "console", "python", "text", "sh" ... slow: marked as such."""

    language: str
    text: str
    slow: bool


@dataclass(frozen=True)
class Step:
    """A command line of a console block, and the lines shown below it."""

    command: str
    shown: tuple[str, ...]


def blocks(page: str) -> list[Block]:
    return [Block(m["language"], m["text"], bool(m["slow"])) for m in _BLOCK.finditer(page)]


def steps(text: str) -> Iterator[Step]:
    """The commands of a console block in order; a line that ends in a backslash goes on."""
    for part in re.split(r"^\$ ", text, flags=re.M)[1:]:
        lines = part.splitlines()
        end = next(k for k, line in enumerate(lines) if not line.endswith("\\")) + 1
        yield Step("\n".join(lines[:end]), tuple(lines[end:]))


def missing(shown: tuple[str, ...] | list[str], printed: str) -> str | None:
    """The first shown line that was not printed where it should have been; None: all were.

    ``...`` stands for any lines; at the end of a line for its rest. Blank lines and the width of
    blanks do not matter, hashes neither, numbers within TOLERANCE.
    """
    lines = [line for line in printed.splitlines() if line.strip()]
    place, free = 0, False
    for want in (line for line in shown if line.strip()):
        if want.strip() == GAP:
            free = True
            continue
        ahead = range(place, len(lines)) if free else range(place, min(place + 1, len(lines)))
        found = next((k for k in ahead if alike(want, lines[k])), None)
        if found is None:
            return want
        place, free = found + 1, False
    return None


def alike(shown: str, printed: str) -> bool:
    """Whether a printed line is the shown one, but for blanks, hashes, times, small differences."""
    cut = shown.rstrip().endswith(GAP)
    wanted, found = _words(shown.rstrip().removesuffix(GAP)), _words(printed)
    if cut:
        found = found[: len(wanted)]
    timed = _TIMED.search(shown) is not None
    return len(wanted) == len(found) and all(
        _same(a, b, timed=timed) for a, b in zip(wanted, found, strict=True)
    )


def _words(line: str) -> list[str]:
    return re.findall(rf"{_NUMBER.pattern}|[^\s\d]+|\d+", _HASH.sub("#", line))


def _same(a: str, b: str, *, timed: bool) -> bool:
    if not (_NUMBER.fullmatch(a) and _NUMBER.fullmatch(b)):
        return a == b
    x, y = (float(text.replace(",", "")) for text in (a, b))
    return timed or math.isclose(x, y, rel_tol=TOLERANCE, abs_tol=1e-12)
