"""Rows against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench.run.latency import LatencySample
from tactibench.run.latency_rows import speed_rows


def test_quantiles_of_a_ramp():
    """0, 1 .. 100 ms: the q quantile is 100 q, the mean 50 ms, 4 frames a call: 80 a second."""
    ramp = np.arange(101.0)
    raw = np.column_stack([0.25 * ramp, 0.75 * ramp])
    rows = speed_rows(LatencySample(("forward", "decode"), raw, True, 40, 2, 4), "offline")
    assert [row["phase"] for row in rows] == ["forward", "decode", "total"]
    for row, share in zip(rows, (0.25, 0.75, 1.0), strict=True):
        assert row["p50_ms"] == pytest.approx(50 * share)
        assert row["p90_ms"] == pytest.approx(90 * share)
        assert row["p99_ms"] == pytest.approx(99 * share)
        assert row["mean_ms"] == pytest.approx(50 * share)
        assert row["per_s"] == pytest.approx(80)
        assert (row["scenario"], row["threads"], row["batch"]) == ("offline", 2, 4)
        assert row["settled"] is True


@given(arrays(np.float64, (17, 3), elements=st.floats(0.001, 1e4)))
def test_rows_are_ordered_and_add_up(raw):
    rows = speed_rows(LatencySample(("a", "b", "c"), raw, False, 500, 1), "single")
    for row in rows:
        assert row["p50_ms"] <= row["p90_ms"] <= row["p99_ms"]
        assert row["settled"] is False
    assert sum(row["mean_ms"] for row in rows[:3]) == pytest.approx(rows[3]["mean_ms"])
    assert rows[3]["per_s"] == pytest.approx(1e3 / rows[3]["mean_ms"])


def test_json_values_only():
    for row in speed_rows(LatencySample(("a",), [[1.0]], True, 40, 1), "single"):
        assert {type(value) for value in row.values()} <= {str, int, float, bool}
