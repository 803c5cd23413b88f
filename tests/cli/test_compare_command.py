"""``tactibench compare``: what a person reads, and one sentence for every mistake."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from stored_answers import answered_parts, store_run

from tactibench.board import Comparison, MetricComparison
from tactibench.report import comparison_table
from tactibench.stats import Estimate


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
    assert any(line.startswith("A  good  misses: missed 1.0 [") for line in lines)
    (mae,) = [line for line in lines if line.startswith("MAE, mm")]
    assert "-0.0900 [-0.0900, -0.0900]" in mae
    assert mae.split()[-3:] == ["1.00/1.00", "7", "1/0"]
    words = " ".join(out.split())
    assert "adjusted for all" in words
    assert "n/a n/a" not in words  # no line of nothing
    assert "not compared: R2, RMSE, RMSE pooled over axes" in words  # by their names
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
    assert "one run alone cannot be compared" in refused("compare", "exp1-one")
    assert "did you mean 'exp1-one'" in refused("compare", "exp1-one", "exp1-onee")


ROW = MetricComparison(
    metric="mae_mm",
    group="mean",
    first=0.1,
    second=0.2,
    difference=Estimate(-0.1, -0.15, -0.05, 40, 40),
    alone=(0, 0),
    misses=(0.0, 0.0),
    p=0.001,
    p_holm=0.01,
)


@pytest.mark.parametrize(
    ("changed", "better"),
    [
        ({}, "A"),
        ({"difference": Estimate(0.1, 0.05, 0.15, 40, 40)}, "B"),
        ({"metric": "resolved"}, "B"),  # more is better
        ({"difference": Estimate(-0.1, -0.25, 0.05, 40, 40)}, ""),
        ({"p": 0.063}, ""),  # the permutation leaves it to chance
        ({"p": None}, ""),
    ],
)
def test_better_takes_the_interval_and_the_permutation(changed, better):
    shown = comparison_table(Comparison(0, 1, (replace(ROW, **changed),)), ("A", "B"))
    heads = [column.head for column in shown.columns]
    assert shown.rows[0][heads.index("better")] == better
