"""A sweep in miniature: small protocols and a plugin that other processes see, too."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest
from command_line import cli, refused  # noqa: F401 - fixtures
from fake_distribution import fake_distribution
from few_presses import few_presses

TESTS = Path(__file__).parents[1]


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The plugin is installed; gives its diary of trainings. This is the folder of the test."""
    site = tmp_path / "site"
    fake_distribution(site, "toy-tactile", toy="toy_tactile.hooks")
    folders = [str(site), str(TESTS / "sweep/fake"), str(TESTS / "run/fake")]
    for folder in folders:
        monkeypatch.syspath_prepend(folder)
    path = os.pathsep.join([*folders, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TOY_DIARY", str(tmp_path / "diary"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "diary").touch()
    yield tmp_path / "diary"
    for name in [name for name in sys.modules if name.startswith(("toy_tactile", "tiny_tactile"))]:
        del sys.modules[name]


@pytest.fixture
def asked(toy: Path, tmp_path: Path) -> Callable[[str], Path]:
    """Keys of a sweep of the small protocols on the small sensor -> its file."""
    few_presses(tmp_path / "protocols")
    few = '"protocols/few-exp1.toml", "protocols/few-exp2.toml"'

    def written(text: str) -> Path:
        file = tmp_path / "sweep.toml"
        keys = dedent(text).lstrip()
        own = keys.startswith("[") or "protocol =" in keys.partition("\n[")[0]
        head = "" if own else f'protocol = [{few}]\nsensor = "toy"\n'
        file.write_text(head + keys, encoding="utf-8")
        return file

    return written


@pytest.fixture
def tactibench(toy: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """The command in a process of its own."""

    def ran(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "tactibench", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=500)

    return ran
