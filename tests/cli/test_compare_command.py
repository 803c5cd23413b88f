"""``tactibench compare``: what a person reads, and one sentence for every mistake."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from stored_answers import answered_parts, store_run


@pytest.fixture
def stored(tmp_path, fabricate):
    def made(name, offset, **more):
        parts = answered_parts(offset, frames=8, missing=more.pop("missing", ()))
        record = fabricate(model=name, encoder=None, name=f"exp1-{name}", **more)
        store_run(tmp_path / "runs", record, parts)

    return made


def test_a_table_with_misses_beside_the_errors(cli, stored):
    stored("good", 0.03)
    stored("poor", 0.3, missing=(1,))
    code, out, err = cli("compare", "exp1-good", "exp1-poor", "--json", "rows.json")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert any(line.startswith("A  good (single)  misses: missed 1.0 [") for line in lines)
    (mae,) = [line for line in lines if line.startswith("MAE, mm")]
    assert "-0.0900 [-0.0900, -0.0900]" in mae
    assert mae.split()[-3:] == ["1.00/1.00", "7", "1/0"]
    assert "adjusted for all" in " ".join(out.split())
    rows = json.loads(Path("rows.json").read_text())
    (row,) = [row for row in rows if row["metric"] == "mae_mm"]
    assert row["value"] == pytest.approx(-0.09)
    assert (row["unit"], row["presses"], row["only_first"]) == ("mm", 7, 1)


def test_three_runs_make_three_tables(cli, stored):
    for k, name in enumerate(("one", "two", "three")):
        stored(name, 0.1 * k)
    out = cli("compare", "exp1-one", "exp1-two", "exp1-three")[1]
    assert [line[:5] for line in out.splitlines() if line[1:4] == " - "] == [
        "A - B",
        "A - C",
        "B - C",
    ]


def test_mistakes(refused, stored):
    stored("one", 0.1)
    stored("other", 0.1, sensor={"instance": 3})
    assert "one run alone cannot be compared" in refused("compare", "exp1-one")
    assert "did you mean 'exp1-one'" in refused("compare", "exp1-one", "exp1-onee")
    assert "is named twice" in refused("compare", "exp1-one", "exp1-one")
    assert "not tested on the same frames" in refused("compare", "exp1-one", "exp1-other")
    assert "missing argument" in refused("compare").lower()
