"""Definitions of a module, read from its source, so that signatures are as they were written."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

from tactibench.errors import UserError


@dataclass(frozen=True)
class Module:
    """A source file and the functions and classes at its top level.

    Attributes:
        path: Path of the file.
        text: Text of the file.
        nodes: Name -> function or class, in the order of the file.
    """

    path: Path
    text: str
    nodes: dict[str, ast.FunctionDef | ast.ClassDef]

    @classmethod
    def read(cls, path: Path) -> Module:
        """Read and parse a file."""
        text = path.read_text(encoding="utf-8")
        defined = (ast.FunctionDef, ast.ClassDef)
        nodes = {node.name: node for node in ast.parse(text).body if isinstance(node, defined)}
        return cls(path, text, nodes)

    def source(self, name: str) -> str:
        """Return the text of a definition with its decorators.

        Raises:
            UserError: The module defines no function or class of this name.
        """
        if name not in self.nodes:
            raise UserError(f"{self.path} shows no {name}; add an example of it.")
        node = self.nodes[name]
        first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
        return "\n".join(self.text.splitlines()[first - 1 : node.end_lineno])


def signature(node: ast.FunctionDef) -> str:
    """Return ``def name(...) -> ...`` without a body."""
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"def {node.name}({ast.unparse(node.args)}){returns}"


def outline(node: ast.ClassDef) -> str:
    """Return a class as a reader needs it: fields, and methods with docstrings as comments."""
    bases = f"({', '.join(map(ast.unparse, node.bases))})" if node.bases else ""
    lines = [f"class {node.name}{bases}:"]
    for item in node.body:
        if isinstance(item, ast.AnnAssign):
            lines.append(f"    {ast.unparse(item)}")
        elif isinstance(item, ast.FunctionDef):
            lines += [f"    {line}" for line in _comment(ast.get_docstring(item))]
            shown = {"property", "classmethod", "staticmethod"}
            names = [
                decorator.id for decorator in item.decorator_list if isinstance(decorator, ast.Name)
            ]
            # A reader uses a cached property as any other: without parentheses.
            names = ["property" if name == "cached_property" else name for name in names]
            lines += [f"    @{name}" for name in names if name in shown]
            lines.append(f"    {signature(item)}: ...")
    return "\n".join(lines)


def _comment(said: str | None) -> list[str]:
    return [f"# {line}".rstrip() for line in said.splitlines()] if said else []
