"""Wilson's equation holds at both ends of a share's interval, and a press counts once at most."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tactibench.stats import effective_size, share_interval


@pytest.mark.parametrize(("hits", "n"), [(1, 12), (12, 40), (39, 40), (500, 1000)])
def test_the_ends_solve_wilsons_equation_with_the_t_quantile(hits: int, n: int) -> None:
    values = np.arange(n) < hits
    estimate = share_interval(values, np.arange(n))
    size = effective_size(values, np.arange(n))
    t = stats.t.ppf(0.975, n - 1)
    for end in (estimate.low, estimate.high):
        assert end is not None
        assert size * (hits / n - end) ** 2 == pytest.approx(t**2 * end * (1 - end))


@pytest.mark.parametrize("odd", [0, 1, 2])
def test_opposite_values_inside_a_press_do_not_count_for_more_than_there_are(odd: int) -> None:
    presses = np.repeat(np.arange(20), 2)
    hits = np.tile([0.0, 1.0], 20)
    hits[: 2 * odd : 2] = 1.0
    assert effective_size(hits, presses) == 40.0
