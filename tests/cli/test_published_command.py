"""``tactibench published``: rows with their source, and notes that are computed again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "leaderboards" / "published"


@pytest.fixture
def tables(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "leaderboards" / "published")
    return tmp_path / "leaderboards" / "published"


def test_check_prints_a_finding_a_line(cli, tables):
    code, out, _ = cli("published", "check", "--json", "rows.json")
    assert code == 0
    assert "tactiverse: note 1 says 0.0816: mean of axes, CNN (single), rmse_mm: 0.0816\n" in out
    assert "CNN (single) and U-Net (single): target_sd_ratio, z: 2.23" in out
    assert out.endswith("every computed figure in the notes is what the tables give\n")
    rows = json.loads(Path("rows.json").read_text())
    assert all(row["agrees"] for row in rows if "agrees" in row)


@pytest.mark.parametrize(("old", "new"), [("0.0816)", "0.0817)"), ("x = 0.0908", "x = 0.0808")])
def test_a_note_or_a_row_that_was_changed_exits_with_1(cli, tables, old, new):
    path = tables / "tactiverse.toml"
    path.write_text(path.read_text().replace(old, new, 1))
    code, out, err = cli("published", "check", "tactiverse")
    assert code == 1
    assert "WRONG" in out
    assert "mend the note or the row" in err


def test_list_shows_every_row(cli, tables):
    code, out, _ = cli("published", "list", "--json", "rows.json")
    assert code == 0
    assert "measured on: hardware TacTip, RTX 5070 Ti" in out
    rows = json.loads(Path("rows.json").read_text())
    (row,) = [r for r in rows if r["metric"] == "coverage"]
    assert (row["table"], row["value"], row["comparable"]) == ("tac-vgnn", 0.968, "yes")


def test_mistakes(refused, tables):
    assert "did you mean 'tactiverse'" in refused("published", "check", "tactivers")
    path = tables / "tactiverse.toml"
    path.write_text(path.read_text().replace('quantity = "n", row = 5', 'quantity = "m", row = 5'))
    assert "key claims.10.quantity" in refused("published", "check")
