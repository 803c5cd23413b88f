"""The first mistake in a validated file, in one sentence."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from tactibench.errors import did_you_mean

LONGEST = 40
"""Most characters of a wrong value that are shown."""

_UNKNOWN = {"extra_forbidden", "unexpected_keyword_argument"}
"""pydantic's types of mistake for a key that is not in the schema: of a model, of a dataclass."""


def first_mistake(error: ValidationError, schema: type[Any]) -> str:
    """Return the first mistake in a sentence: its key, the wrong value and what is allowed.

    Args:
        error: The exception that the validation raised.
        schema: The pydantic model or the dataclass that the file was validated by.
    """
    mistakes: Sequence[Any] = error.errors(include_url=False)
    # A misspelt key is also a missing one: the misspelling says more.
    mistakes = sorted(mistakes, key=lambda mistake: mistake["type"] not in _UNKNOWN)
    mistake = mistakes[0]
    others = len(mistakes) - 1
    more = f" (and {others} more mistake{'s' if others > 1 else ''})" if others else ""
    where = _key(mistake["loc"])
    if mistake["type"] in _UNKNOWN:
        allowed = sibling_keys(schema, mistake["loc"][:-1])
        return f"unknown key {where!r}{more}; {did_you_mean(str(mistake['loc'][-1]), allowed)}"
    if mistake["type"] in {"missing", "missing_argument"}:
        return f"the key {where!r} is missing{more}; add it."
    text = str(mistake["msg"]).removeprefix("Value error, ").rstrip(".")
    if mistake["type"] == "value_error":
        return f"{f'[{where}] ' if where else ''}{text}{more}."
    text = text[:1].lower() + text[1:]
    if not where:
        return f"{text}{more}; restore the file."
    return f"key {where!r} is {_found(mistake['input'])}: {text}{more}."


def _key(where: Sequence[int | str]) -> str:
    """Return the key as ``draws.2.count``, counted from 1 as a reader counts."""
    return ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in where)


def _found(value: Any) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of more digits than Python writes
        text = f"a {type(value).__name__}"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def sibling_keys(schema: type[Any], where: Sequence[int | str]) -> list[str]:
    """Return the names of the keys that are allowed at a place of the schema.

    Args:
        schema: The pydantic model or the dataclass.
        where: Keys and list indices that lead to the place.
    """
    model: type[Any] | None = schema
    for part in where:
        if isinstance(part, int) or model is None:
            continue
        model = _model_in(_keys(model).get(str(part)))
    return [] if model is None else list(_keys(model))


def _keys(model: type[Any]) -> dict[str, Any]:
    """Return key -> type of its value."""
    if is_dataclass(model):
        return {field.name: field.type for field in fields(model)}
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def _model_in(annotation: Any) -> type[Any] | None:
    """Return the table behind ``Table``, ``Table | None`` or ``tuple[Table, ...]``."""
    for candidate in (annotation, *typing.get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None
