"""Protocol files that ship, and ways to write wrong ones."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactibench.protocols import LoadedProtocol, protocol_files, read_protocol

Tables = dict[str, Any]


def tables_of(name: str) -> Tables:
    return tomllib.loads(protocol_files()[name].read_text(encoding="utf-8"))


def toml(tables: Tables) -> str:
    """Enough of a TOML writer for protocol files: scalars, lists, tables, lists of tables."""
    plain, below = [], []
    for key, value in tables.items():
        if isinstance(value, dict):
            below.append(f"[{key}]\n{inline(value)}")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            below += [f"[[{key}]]\n{inline(one)}" for one in value]
        else:
            plain.append(f"{key} = {scalar(value)}\n")
    return "".join(plain) + "\n".join(below)


def inline(table: Tables) -> str:
    """A table of a list, in which tables stand in one line."""
    return "".join(f"{key} = {scalar(value)}\n" for key, value in table.items())


def scalar(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.encode("unicode_escape").decode().replace('"', '\\"') + '"'
    if isinstance(value, dict):
        pairs = (f"{key} = {scalar(one)}" for key, one in value.items())
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, float):
        return repr(value)  # nan, too
    if isinstance(value, list):
        return "[" + ", ".join(scalar(one) for one in value) + "]"
    return repr(value)


@pytest.fixture
def read_tables(tmp_path: Path) -> Callable[[Tables], LoadedProtocol]:
    def read(tables: Tables) -> LoadedProtocol:
        path = tmp_path / "mine.toml"
        path.write_text(toml(tables), encoding="utf-8")
        return read_protocol(path)

    return read


@pytest.fixture
def exp2() -> Tables:
    return tables_of("exp2")


@pytest.fixture
def surface() -> Tables:
    tables = tables_of("surface")
    del tables["recorded"]["test_frames"], tables["recorded"]["test_frames_size"]
    return tables
