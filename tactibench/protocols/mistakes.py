"""What is wrong with a protocol file, in one sentence."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from tactibench.errors import did_you_mean

LONGEST = 40
"""Characters of a found value that are shown."""


def first_mistake(error: ValidationError, schema: type[BaseModel]) -> str:
    """The first mistake with its key, what was found and what is allowed."""
    mistakes: Sequence[Any] = error.errors(include_url=False)
    # A misspelt key is also a missing one: the misspelling says more.
    mistakes = sorted(mistakes, key=lambda mistake: mistake["type"] != "extra_forbidden")
    mistake = mistakes[0]
    others = len(mistakes) - 1
    more = f" (and {others} more mistake{'s' if others > 1 else ''})" if others else ""
    where = _key(mistake["loc"])
    if mistake["type"] == "extra_forbidden":
        known = sibling_keys(schema, mistake["loc"][:-1])
        return f"unknown key {where!r}{more}; {did_you_mean(str(mistake['loc'][-1]), known)}"
    if mistake["type"] == "missing":
        return f"the key {where!r} is missing{more}; add it."
    text = str(mistake["msg"]).removeprefix("Value error, ").rstrip(".")
    if mistake["type"] == "value_error":
        return f"{f'[{where}] ' if where else ''}{text}{more}."
    text = text[:1].lower() + text[1:]
    return f"key {where!r} is {_found(mistake['input'])}: {text}{more}."


def _key(where: Sequence[int | str]) -> str:
    """``draws.2.count``, counted from 1 as a reader counts."""
    return ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in where)


def _found(value: Any) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of more digits than Python writes
        text = f"a {type(value).__name__}"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def sibling_keys(schema: type[BaseModel], where: Sequence[int | str]) -> list[str]:
    """Names of the keys allowed at a place of the schema."""
    model: type[BaseModel] | None = schema
    for part in where:
        if isinstance(part, int) or model is None:
            continue
        fields = {field.alias or name: field for name, field in model.model_fields.items()}
        model = _model_in(fields[str(part)].annotation) if str(part) in fields else None
    if model is None:
        return []
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The table behind ``Table``, ``Table | None`` or ``tuple[Table, ...]``."""
    for candidate in (annotation, *typing.get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None
