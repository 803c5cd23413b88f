"""Fake distributions: a ``.dist-info`` folder and a module on a path of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest
from fake_distribution import fake_distribution

from tactibench.plugins import Problem

HEADER = "from tactibench import *\n"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path of this process; its modules are forgotten afterwards."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        if str(folder) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def install(site: Path) -> Callable[..., Path]:
    """Install one plugin: a distribution of its own with one module ``<plugin>_hooks``."""

    def installed(
        plugin: str, source: str, *, distribution: str | None = None, target: str | None = None
    ) -> Path:
        name = distribution or f"dist-{plugin}"
        module = name.replace("-", "_") + "_hooks"
        (site / f"{module}.py").write_text(HEADER + dedent(source), encoding="utf-8")
        return fake_distribution(site, name, version="1.2", **{plugin: target or module})

    return installed


@pytest.fixture
def only() -> Callable[..., Problem]:
    """The one problem of a plugin."""

    def one(problems: tuple[Problem, ...], plugin: str) -> Problem:
        (problem,) = [found for found in problems if found.origin.plugin == plugin]
        return problem

    return one


@pytest.fixture
def tactibench(site: Path, tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """The command in a process of its own that sees the fake distributions."""

    def ran(*arguments: str) -> subprocess.CompletedProcess[str]:
        path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        environment = {
            **os.environ,
            "PYTHONPATH": path,
            "TACTIBENCH_CACHE": str(tmp_path / "cache"),
        }
        return subprocess.run(
            [sys.executable, "-m", "tactibench", *arguments],
            capture_output=True,
            text=True,
            env=environment,
            timeout=120,
        )

    return ran
