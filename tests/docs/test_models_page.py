"""docs/models.md: every model has a section with three points and a picture of where it fails."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tactibench.plugins import PluginHost

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
MODELS = [n for n, o in PluginHost().models.origins.items() if o.distribution == "tactibench"]
POINTS = ("What it does.", "Speed.", "Where it fails.")


@pytest.fixture(scope="module")
def drawing() -> Iterator[Any]:
    sys.path.insert(0, str(ROOT / "scripts"))
    yield importlib.import_module("draw_models")
    sys.path.remove(str(ROOT / "scripts"))


@pytest.mark.parametrize("model", MODELS)
def test_a_model_has_its_points_in_few_lines_and_a_picture(model: str) -> None:
    section = PAGE.partition(f"\n## `{model}`\n")[2].partition("\n## ")[0]
    text, picture, _ = section.partition(f"](images/fails-{model}.png)")
    assert picture
    assert [point for point in POINTS if f"**{point}**" not in text] == []
    assert len([line for line in text.splitlines() if line.startswith("* ")]) <= 10
    assert f"![Where {model} fails: " in text


def test_every_model_has_a_row_to_draw(drawing: Any) -> None:
    rows = drawing.newest_rows()
    assert set(rows) == set(MODELS)
    assert {row.test_sensor for row in rows.values()} == {None}  # hidden presses are others
    newest = max(
        (drawing.BOARD / "submissions" / "stability").glob("stability-superpose-single-s0-*.json"),
        key=lambda path: re.findall(r'"created": "([^"]*)"', path.read_text(encoding="utf-8")),
    )
    assert rows["superpose"].name == newest.stem


@pytest.mark.long
def test_a_picture_is_drawn(drawing: Any, tmp_path: Path) -> None:
    drawing.draw_model("kernel", drawing.newest_rows(), tmp_path / "kernel.png")
    drawn = (tmp_path / "kernel.png").read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert 50_000 < len(drawn) < 250_000
