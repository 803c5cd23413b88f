"""What is wrong with a file of a data set, in the end of a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import ValidationError

from tactibench.errors import did_you_mean

LONGEST = 40
"""Characters of a found value that are shown."""


def first_mistake(error: ValidationError, known: Sequence[str]) -> str:
    """The first mistake: the key, what was found and what is allowed. known: the keys there are."""
    mistakes = error.errors(include_url=False, include_context=False)
    # A misspelt key is also a missing one: the misspelling says more.
    unknown = {"extra_forbidden", "unexpected_keyword_argument"}
    mistake = min(mistakes, key=lambda one: one["type"] not in unknown)
    key = ".".join(str(part) for part in mistake["loc"])
    if mistake["type"] in unknown:
        return f"unknown key {key!r}; {did_you_mean(key, known)}"
    if mistake["type"] in {"missing", "missing_argument"}:
        return f"the key {key!r} is missing; restore the file."
    text = mistake["msg"].removeprefix("Value error, ").rstrip(".")
    text = text[:1].lower() + text[1:]
    if not key:
        return f"{text}; restore the file."
    found = repr(mistake["input"])
    found = found if len(found) <= LONGEST else f"{found[:LONGEST]}..."
    return f"{key} is {found}: {text}; restore the file."
