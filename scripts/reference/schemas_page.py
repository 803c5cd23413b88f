"""docs/reference/schemas.md: records, submissions, protocols and data sets, key by key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from reference.keys import Keys
from reference.text import anchor, cell, code, grid
from tactibench.datasets import Header, Row, Split
from tactibench.protocols import Protocol
from tactibench.records import Record

Schema = Mapping[str, Any]

FILES: Mapping[str, tuple[str, Any]] = {
    "Record": ("Record: `record.json`", Record),
    "Protocol": ("Protocol: `protocols/*.toml`", Protocol),
    "Header": ("Data set: `dataset.json`", Header),
    "Row": ("Data set: a line of `metadata.jsonl`", Row),
    "Parts": ("Data set: `splits/*.json`", Split),
}


def lines(_root: Path) -> list[str]:
    """Return the lines of the page.

    Raises:
        UserError: keys.toml has no sentence for a key, or a sentence for a key that is gone.
    """
    keys = Keys.read()
    pages = keys.words["pages"]
    page = ["# Schemas", "", *pages["schemas"].strip().splitlines(), ""]
    for name, (title, kind) in FILES.items():
        page += [f"## {title}", "", *pages.get(name, "").strip().splitlines()]
        page += _objects(name, TypeAdapter(kind).json_schema(by_alias=True), keys)
        for following in pages.get("after", {}).get(name, ()):
            page += [*pages[following].strip().splitlines(), ""]
    return page


def _objects(name: str, schema: Schema, keys: Keys) -> Iterator[str]:
    """Yield the lines of the table of an object, and of every object inside it, each once."""
    yield from _table(name, schema, schema, keys)
    for inner in _order(schema, schema):
        yield from [f"### {inner}", *_table(inner, schema["$defs"][inner], schema, keys)]


def _table(name: str, schema: Schema, root: Schema, keys: Keys) -> list[str]:
    properties: Mapping[str, Schema] = schema["properties"]
    sentences = keys.agree(name, properties)
    required = set(schema.get("required", ()))
    rows = []
    for key, of in properties.items():
        default = "required" if key in required else _default(of)
        rows.append([code(key), _words(of, root), default, cell(sentences[key])])
    return grid(["key", "type", "default", "what"], rows)


def _default(of: Schema) -> str:
    if "default" not in of:  # the default is made anew for every file
        return ""
    value = of["default"]
    return (
        ""
        if value is None
        else code(
            str(value).lower()
            if value in (True, False) and isinstance(value, bool)
            else repr(value)
        )
    )


def _order(schema: Schema, root: Schema, seen: list[str] | None = None) -> list[str]:
    """Return the names of the objects inside a schema, in the order in which they first occur."""
    names = [] if seen is None else seen
    for of in schema.get("properties", {}).values():
        for name in _named(of):
            inner = root["$defs"][name]
            if name not in names and "properties" in inner:
                names.append(name)
                _order(inner, root, names)
    return names


def _named(of: Any) -> Iterator[str]:
    if isinstance(of, dict):
        if "$ref" in of:
            yield of["$ref"].rpartition("/")[2]
        for value in of.values():
            yield from _named(value)
    elif isinstance(of, list):
        for value in of:
            yield from _named(value)


def _words(of: Schema, root: Schema) -> str:
    """Return a type of JSON Schema in words, as Markdown."""
    if "$ref" in of:
        name = of["$ref"].rpartition("/")[2]
        return f"[{name}](#{anchor(name)})"
    if "anyOf" in of:
        return " or ".join(_words(option, root) for option in of["anyOf"])
    if "const" in of:
        return code(repr(of["const"]))
    if "enum" in of:
        return " or ".join(code(repr(option)) for option in of["enum"])
    kind = of.get("type")
    if kind == "array":
        return _array(of, root)
    if kind == "object":
        inner = of.get("additionalProperties")
        return f"object of {_words(inner, root)}" if isinstance(inner, dict) and inner else "object"
    names = {
        "string": "text",
        "integer": "whole number",
        "number": "number",
        "null": "null",
        "boolean": "true or false",
    }
    return f"{names.get(str(kind), 'anything')}{_limits(of)}"


def _array(of: Schema, root: Schema) -> str:
    if "prefixItems" in of:
        return f"[{', '.join(_words(item, root) for item in of['prefixItems'])}]".replace(
            "[", "\\[", 1
        )
    least = of.get("minItems")
    return f"list of {_words(of['items'], root)}{f', {least} or more' if least else ''}"


def _limits(of: Schema) -> str:
    signs = {"exclusiveMinimum": "> ", "minimum": ">= ", "exclusiveMaximum": "< ", "maximum": "<= "}
    limits = [f"{sign}{of[key]:,}" for key, sign in signs.items() if key in of]
    if "pattern" in of:
        limits.append(f"matching `{of['pattern']}`")
    return f" ({', '.join(limits)})".replace("<", "&lt;") if limits else ""
