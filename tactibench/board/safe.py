"""What a stranger's record may say: names that are names, and text that only shows itself."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.records.files import parse_json
from tactibench.records.record import Component, Record

NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_-]|\.(?!\.)){0,159}")
"""Of a run, a model, an encoder, a sensor: it becomes part of file names and of pages."""
LONGEST = 4000
"""Characters of a text in a record."""
LARGEST = 2**20
"""Bytes of a record; the longest of those here has 25 kB."""


def read_untrusted(path: Path) -> dict[str, Any]:
    """The JSON object in a file of at most LARGEST bytes, every number finite. Raises UserError."""
    try:
        size = path.stat().st_size
        if path.is_symlink() or not path.is_file():
            raise UserError(f"{path} is no plain file.")
        if size > LARGEST:
            raise UserError(
                f"{path} has {size:,} bytes, more than the {LARGEST:,} that a record may take; "
                "a committed record holds no arrays and no history."
            )
        value = parse_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path} does not exist.") from None
    except (ValueError, RecursionError, OSError) as error:
        raise UserError(f"{path} cannot be read as JSON: {error}.") from None
    if not isinstance(value, dict):
        raise UserError(f"{path} holds a {type(value).__name__}, not a record.")
    return value


def refuse_names(record: Record, where: str) -> None:
    """Raise UserError for a name with markup or a path in it, or text that is not printable.

    The record is valid otherwise (see ``parse_record``).
    """
    for key, name in _names(record):
        if not NAME.fullmatch(name):
            raise UserError(
                f"{where}: {key} is {name[:80]!r}; a name may hold letters, digits, '.', '_' and "
                "'-' only, at most 160, so that it is neither markup nor a path."
            )
    for key, text in _texts(record.json_values()):
        if len(text) > LONGEST or not text.isprintable():
            raise UserError(
                f"{where}: {key} holds a text of {len(text):,} characters that is too long or not "
                f"printable; a text has at most {LONGEST:,} and no control characters."
            )
    for kind, component in _components(record):
        for key, value in component.parameters.items():
            if isinstance(value, str) and re.search(r"[/\\<>]", value):
                raise UserError(
                    f"{where}: {kind}.{key} is {value[:80]!r}; a committed run must not depend on "
                    "a path, nor hold markup."
                )


def _components(record: Record) -> Iterator[tuple[str, Component]]:
    yield "model", record.model
    yield "sensor", record.sensor
    if record.encoder is not None:
        yield "encoder", record.encoder


def _names(record: Record) -> Iterator[tuple[str, str]]:
    yield "name", record.name
    yield "regime", record.regime
    yield "protocol.id", record.protocol.id
    for kind, component in _components(record):
        yield f"{kind}.name", component.name
        yield from ((f"{kind}.parameters", name) for name in component.parameters)
    if record.test_sensor is not None:
        yield "sensor.tested.name", record.test_sensor.name


def _texts(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """All strings of a JSON value, with where they stand."""
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, Mapping):
        for name, inner in value.items():
            yield f"{key}.{name}".lstrip("."), str(name)
            yield from _texts(inner, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner, key)
