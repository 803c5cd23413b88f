"""Fixtures that call the command line in this process, in a folder and with a cache of its own."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tactibench.cli.main import call

Result = tuple[int, str, str]


@pytest.fixture
def cli(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """Arguments, or a whole command line -> exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    # A busy machine must not put a line of progress where a test wants nothing.
    monkeypatch.setattr("tactibench.report.progress.INTERVAL_S", 3600.0)

    def called(*arguments: str | Path) -> Result:
        capsys.readouterr()
        words = shlex.split(str(arguments[0])) if len(arguments) == 1 else map(str, arguments)
        code = call(list(words))
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return called


@pytest.fixture
def refused(cli: Callable[..., Result]) -> Callable[..., str]:
    """Arguments of a mistake -> its one sentence."""

    def mistake(*arguments: str | Path) -> str:
        code, out, err = cli(*arguments)
        assert code == 2, (out, err)
        assert out == ""
        assert err.startswith("tactibench: ")
        assert err.count("\n") == 1, "one line"
        assert err[-2] in ".?)", err
        assert ".." not in err.replace("...", "").replace("../", "").replace("0..", "")
        assert "Traceback" not in err
        return err[len("tactibench: ") : -1]

    return mistake
