"""keys.toml: a sentence for every key of a schema and a source for every metric."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactibench.errors import UserError

FILE = Path(__file__).with_name("keys.toml")


@dataclass(frozen=True)
class Keys:
    """words: table -> key -> sentence."""

    words: Mapping[str, Mapping[str, Any]]

    @classmethod
    def read(cls) -> Keys:
        """Read the sentences of keys.toml."""
        return cls(tomllib.loads(FILE.read_text(encoding="utf-8")))

    def agree(self, table: str, names: Iterable[str]) -> Mapping[str, str]:
        """The sentences of a table. Raises UserError where one is missing or superfluous."""
        said = self.words.get(table, {})
        for name in names:
            if name not in said:
                raise UserError(f"{FILE.name} says nothing about {table}.{name}; add a line there.")
        for name in set(said) - set(names):
            raise UserError(f"{FILE.name} speaks of {table}.{name}, which is gone; remove it.")
        return said
