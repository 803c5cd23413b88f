"""The two-point limit of a test: a median over presses, with an interval by ranks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tactibench.contacts import Contacts
from tactibench.metrics import Trials
from tactibench.metrics.registry import score
from tactibench.stats import median_by_ranks


@pytest.mark.parametrize(("n", "low", "high"), [(6, 1, 6), (10, 2, 9), (20, 6, 15), (40, 14, 27)])
def test_the_limits_are_the_tabulated_ranks(n: int, low: int, high: int) -> None:
    """Ranks of the 95 % interval of a median, as in tables of the sign test."""
    values = np.random.default_rng(n).permutation(np.arange(1.0, n + 1))
    found = median_by_ranks(values)
    assert (found.value, found.low, found.high) == ((n + 1) / 2, low, high)
    assert stats.binom.cdf(low - 1, n, 0.5) <= 0.025 < stats.binom.cdf(low, n, 0.5)


def test_too_few_values_have_no_interval_and_infinite_ones_no_number() -> None:
    assert median_by_ranks(np.arange(5.0)).low is None
    half = median_by_ranks(np.array([0.1] * 6 + [np.inf] * 4))
    assert (half.value, half.low, half.high) == (0.1, 0.1, None)
    most = median_by_ranks(np.array([0.1] * 4 + [np.inf] * 6))
    assert (most.value, most.n) == (None, 10)


def trials(limit: object) -> Trials:
    pair = Contacts(np.array([[-3.0, 0.0], [3.0, 0.0]]), [1.0, 1.0], [1.0, 1.0])
    return Trials((pair,) * 8, (pair,) * 8, np.arange(8), ("6.0",) * 8, limit=limit)


def test_presses_that_were_not_asked_do_not_count() -> None:
    limit = np.array([0.3, np.nan, 0.1, 0.2, np.nan, 0.5, np.inf, np.nan])
    (row,) = score(["limit_mm"], trials(limit), rng=np.random.default_rng(0))
    assert (row.value, row.n, row.clusters, row.unit, row.better) == (0.3, 5, 5, "mm", "none")
    (none,) = score(["limit_mm"], trials(None), rng=np.random.default_rng(0))
    assert (none.value, none.n) == (None, 0)
