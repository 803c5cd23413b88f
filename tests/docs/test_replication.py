"""docs/replication.md: its tables are what the committed records give."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def making() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("make_replication")
    sys.path.remove(str(ROOT / "scripts"))


def test_the_tables_are_what_the_committed_records_give(making: Any) -> None:
    page = making.PAGE.read_text(encoding="utf-8")
    assert making.page_with(page, making.all_tables()) == page


def test_a_system_is_found_by_its_recipe_and_decoder(making: Any, fabricate: Any) -> None:
    from tactibench.board import rows_of

    paper = making.System("unet")
    default = making.System("unet", recipe="default")
    (plain,) = rows_of([fabricate("exp1", "unet", settings={})])
    (published,) = rows_of([fabricate("exp1", "unet", settings={"recipe": "paper"})])
    (multiple,) = rows_of([fabricate("exp1", "unet", regime="multiple")])
    assert [default.is_of(row) for row in (plain, published, multiple)] == [True, False, False]
    assert not paper.is_of(plain)
    assert not paper.is_of(published)  # the decoder is not that of the paper
    published.first.encoder.parameters["decoder"] = "maximum"
    assert paper.is_of(published)


def test_rows_with_another_encoder_are_no_system_of_the_comparison(
    making: Any, fabricate: Any
) -> None:
    from tactibench.board import rows_of

    (row,) = rows_of([fabricate("exp1", "unet", settings={})])
    row.first.encoder.name = "depth"
    assert not making.System("unet", recipe="default").is_of(row)
