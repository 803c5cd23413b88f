"""docs/explanation.md: its table, pictures and measured lines are what the records and the
benchmark give."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from documented import blocks, missing

from tactibench.board import machine

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "explanation.md"


@pytest.fixture(scope="module")
def drawing() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("draw_explanation")
    sys.path.remove(str(ROOT / "scripts"))


def test_the_table_is_what_the_committed_records_give(drawing: Any) -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert drawing.with_table(page, drawing.error_table(drawing.board_rows("exp3"))) == page
    assert drawing.with_table(page, ["| other |"]) != page


@pytest.mark.long
def test_the_pictures_are_drawn(drawing: Any, tmp_path: Path) -> None:
    drawing.misses_picture(tmp_path / "a.png", drawing.board_rows("exp3"))
    drawing.same_machine_picture(tmp_path / "b.png", drawing.board_rows("exp2"))
    for path in (
        *tmp_path.iterdir(),
        *(ROOT / "docs" / "images" / f"{n}.png" for n in ("misses", "same_machine")),
    ):
        assert 10_000 < path.stat().st_size < 200_000


def test_only_seeds_that_computed_alike_on_one_machine_are_drawn_together(drawing: Any) -> None:
    drawn = drawing.timed_alike(drawing.board_rows("exp2"))
    assert drawn
    for row in drawn:
        assert (
            len({(record.timed.get("configuration"), machine(record)) for record in row.records})
            == 1
        )


@pytest.mark.slow
def test_the_coverage_is_what_the_benchmark_prints() -> None:
    page = PAGE.read_text(encoding="utf-8")
    shown = [block for block in blocks(page) if block.language == "text"]
    commands = re.findall(r"`python (benchmarks/interval_coverage\.py [^`]*)`", page)
    for command, block in zip(commands, shown, strict=True):
        done = subprocess.run(
            [sys.executable, *command.split()],
            capture_output=True,
            text=True,
            cwd=ROOT,
            timeout=1800,
        )
        assert missing(block.text.splitlines(), done.stdout) is None, done.stdout
