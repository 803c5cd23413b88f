"""docs/reference/helpers.md: names that a plugin may import besides base classes and specs."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from reference.source import Module, outline, signature
from reference.text import fenced, plain

PACKAGES: Mapping[str, str] = {
    "tactibench": "Contacts, frames and grids, in mm; the signal of frames as arrays.",
    "tactibench.training": "Networks in torch: the loop, recipes, scales of answers, weights.",
    "tactibench.markers": "Pins: found at rest, followed in frames, as a graph, on one layout.",
    "tactibench.superposition": "Fields of single presses, and how presses beside each other add.",
}
"""Public packages, in the order of the page."""
_ELSEWHERE = {f"tactibench.plugins.{name}" for name in ("base", "hookspecs", "parameter", "specs")}
"""Modules that the page of the hooks describes."""
_IMPORT = re.compile(r"^from \.([\w.]+) import (\w+) as \w+$", re.MULTILINE)


def lines(root: Path) -> list[str]:
    """Return the lines of the page."""
    page = [
        "# Helpers for authors",
        "",
        "A plugin may import these names, and those of [hooks and base classes](hooks.md). "
        "Other modules may change without a word. How the parts of a heatmap encoder look, "
        "`tactibench new encoder NAME` shows.",
        "",
    ]
    for package, summary in PACKAGES.items():
        page += [f"## {package}", "", summary, ""]
        folder = root.joinpath(*package.split("."))
        stub = (folder / "__init__.pyi").read_text(encoding="utf-8")
        for module, name in _IMPORT.findall(stub):
            if f"{package}.{module}" not in _ELSEWHERE:
                page += _entry(folder.joinpath(*module.split(".")), package, name)
    return page


def _entry(path: Path, package: str, name: str) -> Iterator[str]:
    """Yield the lines of a function or a class, or the value and docstring of a constant.

    Args:
        path: Path of the module without its suffix.
        package: Package that exports the name.
        name: Name of the function, class or constant.
    """
    module = Module.read(path.with_suffix(".py"))
    node = module.nodes.get(name)
    yield from [f"### `{package}.{name}`", ""]
    if node is None:
        yield from fenced(_constant(module.text, name))
        return
    yield from [plain(_first_paragraph(ast.get_docstring(node))), ""]
    yield from fenced(signature(node) if isinstance(node, ast.FunctionDef) else _public(node))


def _public(node: ast.ClassDef) -> str:
    """Return the outline of a class without its private methods."""
    shown = [
        item
        for item in node.body
        if not isinstance(item, ast.FunctionDef)
        or not item.name.startswith("_")
        or item.name in ("__init__", "__call__", "__len__")
    ]
    return outline(ast.ClassDef(node.name, node.bases, node.keywords, shown, node.decorator_list))


def _first_paragraph(docstring: str | None) -> str:
    return " ".join((docstring or "").partition("\n\n")[0].split())


def _constant(text: str, name: str) -> str:
    """Return the assignment of a name, with the docstring below it as a comment."""
    body = ast.parse(text).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            docstring = ast.unparse(after) if isinstance(after, ast.Expr) else ""
            comment = " ".join(ast.literal_eval(docstring).split()) if docstring else ""
            return f"# {comment}\n{ast.unparse(node)}" if comment else ast.unparse(node)
    return name
