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
    """The sentences of keys.toml.

    Attributes:
        words: Table -> key -> sentence.
    """

    words: Mapping[str, Mapping[str, Any]]

    @classmethod
    def read(cls) -> Keys:
        """Read the sentences of keys.toml."""
        return cls(tomllib.loads(FILE.read_text(encoding="utf-8")))

    def agree(self, table: str, names: Iterable[str]) -> Mapping[str, str]:
        """Return key -> sentence of a table.

        Args:
            table: Name of the table.
            names: Keys that the table must have.

        Raises:
            UserError: The table lacks one of the keys, or has another one.
        """
        sentences = self.words.get(table, {})
        for name in names:
            if name not in sentences:
                raise UserError(f"{FILE.name} says nothing about {table}.{name}; add a line there.")
        for name in set(sentences) - set(names):
            raise UserError(f"{FILE.name} speaks of {table}.{name}, which is gone; remove it.")
        return sentences
