"""docs/reference/api.md: functions and results of ``tactibench.api``."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from reference.source import Module, outline, signature
from reference.text import fenced, prose


def lines(root: Path) -> list[str]:
    """Return the lines of the page."""
    module = Module.read(root / "tactibench" / "api.py")
    public = {name: node for name, node in module.nodes.items() if not name.startswith("_")}
    page = ["# Python", "", *prose(ast.get_docstring(ast.parse(module.text))), ""]
    page += ["A notebook that uses all of it: [docs/api.ipynb](../api.ipynb).", "", "## Functions"]
    functions = {n: one for n, one in public.items() if isinstance(one, ast.FunctionDef)}
    for name, function in functions.items():
        page += [*_heading(name, function.args.args), *fenced(signature(function))]
        page += [*prose(ast.get_docstring(function)), ""]
    page += ["## Results", ""]
    for name, node in public.items():
        if isinstance(node, ast.ClassDef):
            page += [f"### `{name}`", "", *prose(ast.get_docstring(node)), ""]
            page += fenced(outline(node))
    return page


def _heading(name: str, arguments: list[ast.arg]) -> Iterator[str]:
    yield from ["", f"### `{name}({', '.join(argument.arg for argument in arguments)})`", ""]
