"""By which number a cell of a table sorts: the one that is printed in it."""

from __future__ import annotations

import re

_NUMBER = re.compile(r"[<>]?\s*(-?[\d,]*\.?\d+(?:e[+-]?\d+)?)(?:\s*([kMG]))?(?![\w.,])")
_DURATION = re.compile(r"(?:(\d+) h)?\s*(?:(\d+) min)?\s*(?:([\d.]+) s)?")
_PREFIX = {None: 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


def sort_value(text: str) -> float | None:
    """ "0.0500" -> 0.05, "< 6.50" -> 6.5, "1.9 M" -> 1.9e6, "4 min 5 s" -> 245; None: no number."""
    text = text.strip()
    time = _DURATION.fullmatch(text)
    if text and time:
        hours, minutes, seconds = (float(part or 0) for part in time.groups())
        return 3600 * hours + 60 * minutes + seconds
    found = _NUMBER.match(text)
    return None if found is None else float(found[1].replace(",", "")) * _PREFIX[found[2]]
