"""docs/replication.md: its tables are made of the committed records."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace as Names
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def making() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("make_replication")
    sys.path.remove(str(ROOT / "scripts"))


def test_the_tables_are_made_of_the_committed_records(making: Any) -> None:
    """The merge makes them: a new row does not wait for them."""
    tables = making.all_tables()
    made = making.page_with(making.PAGE.read_text(encoding="utf-8"), tables)
    assert making.page_with(made, tables) == made


def test_a_difference_is_of_the_same_presses(making: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def board(*presses: str) -> Any:
        rows = {name: [Names(name=f"{name}{k}") for k in range(3)] for name in ("unet", "cnn")}
        errors = {f"unet{k}": Names(press=["a", "b"], error=np.ones(2)) for k in range(3)}
        errors |= {f"cnn{k}": Names(press=presses, error=np.zeros(2)) for k in range(3)}
        return Names(row=lambda system: Names(records=rows[system.model]), errors=errors)

    systems = making.paper("unet"), making.paper("cnn")
    assert making._difference(board("a", "c"), *systems) == making.OTHER_PRESSES
    cell = making._difference(board("a", "b"), *systems)
    assert (cell.value, cell.interval) == (1.0, (1.0, 1.0))  # no variance, and no NaN


def test_a_system_is_found_by_its_recipe_and_decoder(making: Any, fabricate: Any) -> None:
    from tactibench.board import rows_of

    paper, default = making.paper("unet"), making.default("unet")
    (plain,) = rows_of([fabricate("exp1", "unet", settings={})])
    (published,) = rows_of([fabricate("exp1", "unet", settings={"recipe": "paper"})])
    (multiple,) = rows_of([fabricate("exp1", "unet", regime="multiple")])
    assert [default.is_of(row) for row in (plain, published, multiple)] == [True, False, False]
    assert not paper.is_of(plain)
    assert not paper.is_of(published)  # the decoder is not that of the paper
    encoder = published.first.encoder
    encoder.parameters["decoder"] = "maximum"
    encoder.settings.append("decoder")
    assert paper.is_of(published)
    assert not making.paper("unet", threshold=0.2).is_of(published)
    encoder.parameters["threshold"] = 0.2
    encoder.settings.append("threshold")
    assert making.paper("unet", threshold=0.2).is_of(published)
    assert not paper.is_of(published)


def test_rows_with_another_encoder_are_no_system_of_the_comparison(
    making: Any, fabricate: Any
) -> None:
    from tactibench.board import rows_of

    (row,) = rows_of([fabricate("exp1", "unet", settings={})])
    row.first.encoder.name = "depth"
    assert not making.default("unet").is_of(row)
