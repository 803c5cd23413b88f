"""Identities: whatever changes a result changes its key."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any


def canonical(value: Any) -> str:
    """Return one text for equal JSON values. Raises ValueError on NaN."""
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

    A version number says what an author remembered to change; this says what changed. without:
    folders directly inside the package that are left out. Raises ModuleNotFoundError.
    """
    files = [(name, path) for name, path in _files(package) if Path(name).parts[0] not in without]
    lines = [f"{name} {hashlib.sha256(p.read_bytes()).hexdigest()}" for name, p in sorted(files)]
    return combined(lines)


def code_mentions(package: str, names: Iterable[str]) -> bool:
    """Return whether any Python file of an import package or module holds one of the names.

    Raises ModuleNotFoundError.
    """
    sources = [path.read_bytes() for _, path in _files(package) if path.suffix == ".py"]
    return any(name.encode() in source for source in sources for name in names)


def _files(package: str) -> list[tuple[str, Path]]:
    """Files of a package, by their path inside it."""
    spec = find_spec(package)
    if spec is None:
        raise ModuleNotFoundError(package)
    if not spec.submodule_search_locations:
        return [(Path(str(spec.origin)).name, Path(str(spec.origin)))]
    roots = [Path(place) for place in spec.submodule_search_locations]
    return [(path.relative_to(root).as_posix(), path) for root in roots for path in _code(root)]


def _code(root: Path) -> list[Path]:
    """Every file but byte code and hidden ones (an editor's or a system's)."""
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


@lru_cache(maxsize=64)  # a process goes on with what it has imported; 4 ms to read
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def code_commit(folder: Path) -> str:
    """Commit of the checkout the code runs from, ``+dirty`` with changes, or "installed"."""
    try:
        where = ["git", "-C", str(folder)]
        tracked = [*where, "ls-files", "--error-unmatch", "pyproject.toml"]
        subprocess.run(tracked, check=True, capture_output=True, timeout=10)
        head = subprocess.run(
            [*where, "rev-parse", "HEAD"], check=True, capture_output=True, text=True, timeout=10
        )
        status = subprocess.run(
            [*where, "status", "--porcelain"],
            check=True,
            capture_output=True,
            text=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return "installed"
    return head.stdout.strip() + ("+dirty" if status.stdout.strip() else "")
