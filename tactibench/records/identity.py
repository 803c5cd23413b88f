"""Identities: whatever changes a result changes its key."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any


def canonical(value: Any) -> str:
    """Return one text for equal JSON values.

    Raises:
        ValueError: A number is NaN or infinite.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def digest(value: Any) -> str:
    """Return sha256 of a JSON value."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def combined(parts: Iterable[str]) -> str:
    """Return sha256 of hashes in order."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@lru_cache(maxsize=64)
def code_hash(package: str, without: frozenset[str] = frozenset()) -> str:
    """Return sha256 over the source and data files of an import package or module.

    A version number says what an author remembered to change; this says what changed.

    Args:
        package: Import name of the package or module.
        without: Folders directly inside the package that are left out.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    files = [(name, path) for name, path in _files(package) if Path(name).parts[0] not in without]
    lines = [f"{name} {hashlib.sha256(p.read_bytes()).hexdigest()}" for name, p in sorted(files)]
    return combined(lines)


@lru_cache(maxsize=64)
def outside_packages(package: str) -> tuple[str, ...]:
    """Return the packages and modules that a package imports and that nobody installed.

    These are files of the author's, such as ``mylib.py`` beside the plugin, and what they import in
    turn. Python's own modules, installed packages and tactibench have versions or hashes of their
    own.

    Args:
        package: Import name of the package or module.
    """
    found = {package}
    waiting = [package]
    while waiting:
        for _, path in _files(waiting.pop()):
            if path.suffix == ".py":
                source = path.read_text(encoding="utf-8", errors="replace")
                new = {name for name in _imported(source) - found if _is_outside(name)}
                found |= new
                waiting += new
    return tuple(sorted(found - {package}))


IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+(\w+)|import[ \t]+([\w., \t]+))", re.MULTILINE)


def _imported(source: str) -> set[str]:
    """Return the top-level names that a source imports, and some words of its texts."""
    lists = (one or several for one, several in IMPORT.findall(source))
    return {name for text in lists for name in re.findall(r"(?:^|,)[ \t]*(\w+)", text)}


def _is_outside(name: str) -> bool:
    if name in sys.stdlib_module_names or name == "tactibench":
        return False
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return False
    if spec is None or spec.origin is None:  # a folder without a module is no package of code
        return False
    return not {"site-packages", "dist-packages"} & set(Path(spec.origin).parts)


def code_mentions(package: str, names: Iterable[str]) -> bool:
    """Return whether any Python file of an import package or module holds one of the names.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    sources = [path.read_bytes() for _, path in _files(package) if path.suffix == ".py"]
    return any(name.encode() in source for source in sources for name in names)


def _files(package: str) -> list[tuple[str, Path]]:
    """Return the files of a package, with their paths inside it."""
    spec = find_spec(package)
    if spec is None:
        raise ModuleNotFoundError(package)
    if not spec.submodule_search_locations:
        return [(Path(str(spec.origin)).name, Path(str(spec.origin)))]
    roots = [Path(place) for place in spec.submodule_search_locations]
    return [(path.relative_to(root).as_posix(), path) for root in roots for path in _code(root)]


def _code(root: Path) -> list[Path]:
    """Return all files but byte code and hidden files (of an editor or the system)."""
    files = []
    for path in root.rglob("*"):
        inside = path.relative_to(root).parts
        if "__pycache__" in inside or any(part.startswith(".") for part in inside):
            continue
        if path.is_file():
            files.append(path)
    return files


def installed_versions(*distributions: str) -> dict[str, str]:
    """Return the version of every distribution, read without importing it."""
    return {name: _version(name) for name in distributions}


@lru_cache(maxsize=64)  # reading takes 4 ms, and a process keeps the version that it imported
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def code_commit(folder: Path) -> str:
    """Return the commit of the checkout that the code runs from.

    Returns:
        The hash of the commit, with ``+dirty`` where files were changed; "installed" where the code
        does not run from a checkout.
    """
    where = ["git", "-C", str(folder)]
    commands = ("ls-files --error-unmatch pyproject.toml", "rev-parse HEAD", "status --porcelain")
    try:
        _, head, changed = (
            subprocess.check_output(
                [*where, *command.split()],
                stderr=subprocess.DEVNULL,
                text=True,
                timeout=10,
            ).strip()
            for command in commands
        )
    except (OSError, subprocess.SubprocessError):
        return "installed"
    return f"{head}+dirty" if changed else head
