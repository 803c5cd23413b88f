"""Text of strangers in a page: nothing that a plugin calls itself is ever markup or code."""

from __future__ import annotations

import json
from typing import Any

_IN_SCRIPT = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}
_IN_FIGURE = str.maketrans({"<": "&lt;", ">": "&gt;", "&": "&amp;", "$": "\u200b$"})


def script_json(value: Any) -> str:
    """JSON that may stand in a script element: no tag can end it, no line separator breaks it.

    The escapes are JSON's own, so that it parses to the very same value. Raises ValueError on NaN.
    """
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.translate(_IN_SCRIPT)


def figure_text(text: str) -> str:
    """One line for a label or hover text of Plotly, which reads some HTML, and TeX between $."""
    return " ".join(text.split()).translate(_IN_FIGURE)
