"""The table of a comparison: who is called better, and when nobody is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tactibench.board import Comparison, MetricComparison
from tactibench.report import comparison_table
from tactibench.stats import Estimate

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
