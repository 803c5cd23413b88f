"""Where a source could hide what is not finite: tiny numbers, ``nan_to_num`` and their like."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

TINY = 1e-3
"""Constants up to this, as a summand or as a bound, are floors that keep something from zero."""
BOUNDS = {
    "clamp",
    "clamp_min",
    "clamp_max",
    "clip",
    "max",
    "maximum",
    "min",
    "minimum",
    "fmax",
    "fmin",
}
SILENT = {"nan_to_num", "fmax", "fmin"}
"""Calls that swallow a NaN, besides ``nanmean`` and all others that begin with nan."""
NAMED = {"eps", "epsilon", "atol", "rtol"}


def occurrences(path: Path) -> list[tuple[str, str]]:
    """(function, expression as ``ast.unparse`` writes it) of every one, in order."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    known = {
        target.id: value
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name) and (value := _value(node.value, {})) is not None
    }
    return list(_within(tree, "", known))


def _within(node: ast.AST, place: str, known: dict[str, float]) -> Iterator[tuple[str, str]]:
    for child in ast.iter_child_nodes(node):
        inside = place
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            inside = f"{place}.{child.name}".lstrip(".")
        if _hides(child, known):
            yield inside, ast.unparse(child)
        yield from _within(child, inside, known)


def _hides(node: ast.AST, known: dict[str, float]) -> bool:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        return _tiny(node.left, known) or _tiny(node.right, known)
    if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub):
        return _tiny(node.value, known)
    if not isinstance(node, ast.Call):
        return False
    name = _name(node.func)
    if name in SILENT or (name.startswith("nan") and name != "nan"):
        return True
    if any(word.arg in NAMED for word in node.keywords):
        return True
    return name in BOUNDS and any(_tiny(value, known) for value in node.args)


def _name(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def _tiny(node: ast.expr, known: dict[str, float]) -> bool:
    value = _value(node, known)
    return value is not None and 0 < abs(value) <= TINY


def _value(node: ast.expr, known: dict[str, float]) -> float | None:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = _value(node.operand, known)
        return None if inner is None else -inner
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)
    return None
