"""Imports, packages and sizes, read from the source; each check names every offender.

Layers, and that the core imports no plugin and plugins not each other, are `lint-imports`'s.
"""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import tactibench

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "tactibench"
PLUGINS = sorted(path for path in (ROOT / "plugins").iterdir() if (path / "__init__.py").is_file())
PLUGIN_NAMES = {path.name for path in PLUGINS}
PUBLIC_MODULES = (
    "tactibench.datasets",
    "tactibench.geometry",
    "tactibench.lab",
    "tactibench.live",
    "tactibench.markers",
    "tactibench.png",
    "tactibench.records",
    "tactibench.report",
    "tactibench.superposition",
    "tactibench.training",
)
HEAVY = {"torch", "cv2"}
Import = tuple[str, tuple[str, ...]]
"""Module, and the names taken from it; () for a plain ``import module``."""


def imports(path: Path, *, at_import_time: bool = False) -> Iterator[Import]:
    """Absolute imports of a file; ``at_import_time``: without functions and TYPE_CHECKING."""
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide who imports whom"
            yield str(node.module), tuple(alias.name for alias in node.names)
        elif at_import_time and isinstance(
            node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
        ):
            continue
        elif at_import_time and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            waiting.extend(node.orelse)
            continue
        waiting.extend(ast.iter_child_nodes(node))


def sources(*folders: Path) -> list[Path]:
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_plugins_import_public_names_only() -> None:
    offenders = []
    for path in sources(*PLUGINS):
        for module, names in imports(path):
            if module.partition(".")[0] == "tactibench":
                offered = offered_names(module)
                offenders += [f"{named(path)}: {module} {n}" for n in names if n not in offered]
                if not offered:
                    offenders.append(f"{named(path)}: {module} is not public")
    assert offenders == []


def offered_names(module: str) -> set[str]:
    """Return the public names of a module of the core; empty for one that is not public."""
    if module == "tactibench":
        submodules = {name.partition(".")[2] for name in PUBLIC_MODULES}
        return {*tactibench.__all__, "__version__", *submodules}
    if module not in PUBLIC_MODULES:
        return set()
    public = importlib.import_module(module)
    return set(getattr(public, "__all__", None) or (n for n in dir(public) if n[0] != "_"))


def test_the_core_loads_nothing_heavy_at_import_time() -> None:
    training = CORE / "training"
    offenders = [
        f"{named(path)}: {module}"
        for path in sources(CORE)
        if path.parent != training or path.name == "__init__.py"  # its modules hold networks
        for module, _ in imports(path, at_import_time=True)
        if module.partition(".")[0] in HEAVY
    ]
    assert offenders == []


def test_hooks_are_light() -> None:
    allowed = {"__future__", "tactibench", "collections", "dataclasses", "typing"}
    offenders = [
        f"{plugin.name}: {module}"
        for plugin in PLUGINS
        for module, _ in imports(plugin / "hooks.py")
        if module.partition(".")[0] not in {*allowed, plugin.name}
    ]
    assert offenders == []


def test_importing_a_plugin_package_loads_nothing_of_it() -> None:
    """A package says what it is and, where others use it, lists its public names."""
    packages = ", ".join(sorted(PLUGIN_NAMES))
    code = f"import sys, {packages}; print(*(m for m in sys.modules if m[:11] == 'tactibench_'))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert set(done.stdout.split()) == PLUGIN_NAMES


def test_every_plugin_package_is_declared_and_packed() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    targets = project["project"]["entry-points"]["tactibench"].values()
    assert sorted(targets) == sorted(f"{name}.hooks" for name in PLUGIN_NAMES)
    packed = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert sorted(packed) == sorted(["tactibench", *(f"plugins/{n}" for n in PLUGIN_NAMES)])


def test_all_is_exactly_what_is_public_and_resolves() -> None:
    assert sorted(tactibench.__all__) == list(dir(tactibench))
    assert len(set(tactibench.__all__)) == len(tactibench.__all__)
    assert all(hasattr(tactibench, name) for name in tactibench.__all__)
    with pytest.raises(AttributeError, match="attribute PluginHost"):
        _ = tactibench.PluginHost  # type: ignore[attr-defined]
