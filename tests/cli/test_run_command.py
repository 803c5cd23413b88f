"""``tactibench run``: ten lines, all of it with --full, and nothing else with --quiet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactibench.cli.main import main
from tactibench.cli.output import Terminal
from tactibench.report import ProgressLines
from tactibench.run import NullReporter

RUN = "run exp1 --model nearest --quick --limit 3"


@pytest.mark.long
def test_a_run_prints_ten_lines_and_all_on_demand(cli: Callable[..., Any], tmp_path: Path) -> None:
    code, first, err = cli(RUN)
    assert (code, err) == (0, "")
    plan, results = first.splitlines()[:3], first.splitlines()[3:]
    assert plan[0].startswith("plan: exp1-nearest-single-quick-")
    assert len(results) <= 15  # two of them: partial, and no interval
    assert not any(line.startswith("published") for line in results)
    full = cli(f"{RUN} --full")[1]
    for text in ("published: ", "Also measured", "scenario", "record: ", "place: "):
        assert text in full
    quiet = cli(f"{RUN} --quiet")
    assert quiet == cli(f"--quiet {RUN}")
    assert quiet[1].splitlines() == results
    (folder,) = (path for path in (tmp_path / "runs").iterdir() if path.is_dir())
    scored = cli("score", folder.name)[1]
    assert scored.splitlines()[: len(results)] == results


def test_quiet_shows_no_progress() -> None:
    with main.make_context("tactibench", ["--quiet", "doctor"]) as context, context:
        assert Terminal().quiet
        assert isinstance(Terminal()._progress, NullReporter)
    assert isinstance(Terminal()._progress, ProgressLines)
