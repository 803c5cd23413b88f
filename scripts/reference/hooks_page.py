"""docs/reference/hooks.md: every hook, its spec, the base class behind it, an example."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

from reference.source import Module, outline, signature
from reference.text import anchor, cell, code, fenced, grid, prose
from tactibench.errors import UserError
from tactibench.plugins import HOOKS, Parameter, hookspecs

EXAMPLE = "docs/examples/tactile_pocket"
BASE_CLASSES = {"ModelSpec": "Model", "SensorSpec": "Sensor", "EncoderSpec": "Encoder"}
"""Spec -> the class from which the class behind its target inherits."""


def lines(root: Path) -> list[str]:
    """Return the lines of the page.

    Raises:
        UserError: The example plugin does not implement a hook, a declaration in it names no
            target, or an optional method of a base class does not state its default.
    """
    written = Module.read(root / "tactibench" / "plugins" / "hookspecs.py")
    shown = Module.read(root / EXAMPLE / "hooks.py")
    page = ["# Hooks", "", *_opening()]
    for hook in HOOKS:
        page += _hook(root, hook, written, shown)
    page += ["## Parameters", "", *prose(Parameter.__doc__), *_fields(Parameter)]
    return [*page, *_base_classes(Module.read(root / "tactibench" / "plugins" / "base.py"))]


def _opening() -> Iterator[str]:
    yield (
        "A plugin is a module named by an entry point of group `tactibench`. It implements any of "
        "these hooks, marked with `@hookimpl`; each takes nothing and gives specs, in any iterable."
    )
    yield ""
    yield from fenced('[project.entry-points.tactibench]\npocket = "tactile_pocket.hooks"', "toml")
    yield (
        "A spec is light and frozen; its `target`, `package.module:Class`, is imported when it is "
        "used. A plugin that fails to load or declares something else is named by "
        "`tactibench doctor`, and the others work. Of two plugins that offer one name neither is "
        "used. `tactibench new` writes a package with all of this."
    )
    yield from grid(
        ["hook", "declares"],
        [[f"[`{hook}`](#{anchor(hook)})", f"`{_declared(hook).__name__}`"] for hook in HOOKS],
    )


def _declared(hook: str) -> type[Any]:
    """Return the class of the specs that a hook returns."""
    (spec,) = get_args(get_type_hints(getattr(hookspecs, hook))["return"])
    return spec  # type: ignore[no-any-return]


def _hook(root: Path, hook: str, written: Module, shown: Module) -> Iterator[str]:
    spec, node = _declared(hook), written.nodes[hook]
    assert isinstance(node, ast.FunctionDef)  # noqa: S101
    yield from [f"## {hook}", "", *fenced(signature(node)), *prose(ast.get_docstring(node)), ""]
    yield from [f"### {spec.__name__}", "", *prose(spec.__doc__), *_fields(spec)]
    if spec.__name__ in BASE_CLASSES:
        base = BASE_CLASSES[spec.__name__]
        yield from [f"The class behind `target` inherits from [`{base}`](#{anchor(base)}).", ""]
    yield from ["Example, the declaration and what stands behind it:", ""]
    source = shown.source(hook)
    yield from fenced(source)
    target = root / EXAMPLE / f"{_target(source, shown.path)}.py"
    yield from fenced(target.read_text(encoding="utf-8"))


def _target(source: str, path: Path) -> str:
    """Return the name of the module, inside the example's package, that a declaration names.

    Raises:
        UserError: The declaration names no target in the example's package.
    """
    texts = [n.value for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Constant)]
    package = Path(EXAMPLE).name
    named = [t for t in texts if isinstance(t, str) and t.startswith(f"{package}.") and ":" in t]
    if not named:
        raise UserError(f"{path}: a declaration names no target in {package}; name one.")
    return named[0].partition(":")[0].removeprefix(f"{package}.")


def _fields(spec: type[Any]) -> list[str]:
    rows = []
    for field in fields(spec):
        required = field.default is MISSING and field.default_factory is MISSING
        value = field.default if field.default_factory is MISSING else field.default_factory()
        default = "" if required else code(repr(value))
        rows.append([code(field.name), code(str(field.type)), default])
    return grid(["field", "type", "default"], rows)


def _base_classes(module: Module) -> Iterator[str]:
    yield from ["## Base classes", "", *prose(ast.get_docstring(ast.parse(module.text))), ""]
    classes = {name: node for name, node in module.nodes.items() if isinstance(node, ast.ClassDef)}
    bases = [base for base in BASE_CLASSES.values() if base in classes]
    yield "Methods that a plugin may write:"
    yield from grid(
        ["class", "method", "meaning", "default"],
        [
            [f"[`{base}`](#{anchor(base)})", code(method.name), *map(cell, _meaning(method))]
            for base in bases
            for method in _optional_methods(classes[base])
        ],
    )
    for name in [*bases, *(name for name in classes if name not in bases)]:
        node = classes[name]
        yield from [f"### {name}", "", *prose(ast.get_docstring(node)), "", *fenced(outline(node))]


def _optional_methods(node: ast.ClassDef) -> Iterator[ast.FunctionDef]:
    for item in node.body:
        if isinstance(item, ast.FunctionDef):
            decorators = [ast.unparse(decorator) for decorator in item.decorator_list]
            if "abstractmethod" not in decorators:
                yield item


def _meaning(method: ast.FunctionDef) -> tuple[str, str]:
    """Return the first sentence of a method's docstring, and its default.

    Raises:
        UserError: The docstring does not state a default.
    """
    docstring = " ".join((ast.get_docstring(method) or "").split())
    meaning, _, default = docstring.partition("Default: ")
    if not default:
        raise UserError(f"the optional method {method.name} does not state its default; add it.")
    return meaning.partition(". ")[0].rstrip(". "), default.rstrip(".")
