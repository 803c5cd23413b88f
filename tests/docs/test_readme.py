"""README.md is short, and its table is what the committed records give."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
LONGEST_SENTENCE = 30
"""Words; the aim is 25."""


@pytest.fixture(scope="module")
def drawing() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("draw_readme")
    sys.path.remove(str(ROOT / "scripts"))


def test_the_table_is_what_the_committed_records_give(drawing: Any) -> None:
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = drawing.read_lines()
    assert drawing.page_with(page, lines) == page
    assert drawing.page_with(page, lines[1:]) != page


@pytest.mark.long
def test_the_picture_is_drawn(drawing: Any, tmp_path: Path) -> None:
    drawing.draw(drawing.read_lines(), tmp_path / "a.png")
    for path in (tmp_path / "a.png", ROOT / "docs" / "images" / "instances.png"):
        assert 10_000 < path.stat().st_size < 200_000


def test_the_page_is_short_and_its_sentences_are_plain() -> None:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert sum(not line.startswith("|") for line in lines) <= 100  # rows of tables are figures
    fenced = False
    for line in lines:
        fenced ^= line.startswith("```")
        if not fenced and line and line[0] not in "|!`#<":
            for sentence in line.split(". "):
                assert len(sentence.split()) <= LONGEST_SENTENCE, sentence
