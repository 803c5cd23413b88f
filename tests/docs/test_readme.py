"""README.md is short, and its table is made of the committed records."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tactibench.report import real_page

ROOT = Path(__file__).resolve().parents[2]
LONGEST_SENTENCE = 30
"""Words; the aim is 25."""


@pytest.fixture(scope="module")
def drawing() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("draw_readme")
    sys.path.remove(str(ROOT / "scripts"))


def test_the_table_is_made_of_the_committed_records(drawing: Any) -> None:
    """The merge makes it: a new row does not wait for it."""
    records = drawing.read_records()
    lines, said = drawing.shipped_lines(records), real_page(records).validity
    made = drawing.page_with((ROOT / "README.md").read_text(encoding="utf-8"), lines, said)
    assert drawing.page_with(made, lines, said) == made
    assert drawing.page_with(made, lines[len(lines) // 2 :], said) != made
    assert drawing.page_with(made, lines, "") != made


@pytest.mark.long
def test_the_picture_is_drawn(drawing: Any, tmp_path: Path) -> None:
    drawing.draw(drawing.shipped_lines(drawing.read_records()), tmp_path / "a.png")
    for path in (tmp_path / "a.png", ROOT / "docs" / "images" / "instances.png"):
        assert 10_000 < path.stat().st_size < 200_000


def test_the_page_is_short_and_its_sentences_are_plain() -> None:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 90
    assert max(line.count(" | ") + 1 for line in lines if line.startswith("| ")) <= 6
    fenced = False
    for line in lines:
        fenced ^= line.startswith("```")
        if not fenced and line and line[0] not in "|!`#<":
            for sentence in line.split(". "):
                assert len(sentence.split()) <= LONGEST_SENTENCE, sentence
