"""Numbers as text, the same in a terminal, a table and a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial

Format = Callable[[float], str]


def number(value: float, decimals: int) -> str:
    """Return a value with fixed decimals; one that would read as zero keeps one digit."""
    if value and abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.0e}"
    return f"{value:,.{decimals}f}"


def fixed(decimals: int) -> Format:
    """Return the format with this number of decimals."""
    return partial(number, decimals=decimals)


def significant(value: float, digits: int = 3) -> str:
    """Return a value with at least ``digits`` significant digits: 0.0123, 6.12, 1,234."""
    if not value:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"


def general(value: float) -> str:
    """Return a value with three significant digits, without trailing zeros: 0.21, 6.5, 64."""
    return f"{value:.3g}"


def scaled(value: float) -> str:
    """Return a large count with its prefix: 950, 12.3 k, 1.93 M, 2.1 G."""
    for size, prefix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if abs(value) >= size:
            return f"{value / size:.3g}{prefix}"
    return f"{value:.4g}"


def duration(seconds: float) -> str:
    """Return a time in words, such as "0.4 s", "38 s", "4 min 5 s" or "1 h 2 min"."""
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def span(counts: Iterable[int]) -> str:
    """Return the range of counts: "1,000", or "998 to 1,000" where they differ."""
    numbers = list(counts)
    low, high = min(numbers, default=0), max(numbers, default=0)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def plural(count: int, noun: str) -> str:
    """Return a count with its noun: "1 seed", "3 seeds"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
