"""Position, depth and relative depth of matched contacts, against plain loops."""

from itertools import combinations, permutations

import numpy as np
import pytest

from tactibench.metrics.registry import score

NAMES = ["position_mean_mm", "position_ungated_mm", "depth_mae_mm", "relative_depth_mae_mm"]


def plain(trials, group):
    """All four by trying every assignment."""
    out = {name: [] for name in NAMES}
    for t, p, g in zip(trials.truth, trials.predictions, trials.group, strict=True):
        if g == "catch" or (group != "all" and g != group):
            continue
        d = np.linalg.norm(t.xy[:, None] - p.xy[None], axis=-1)
        k = min(d.shape)
        ways = [
            list(zip(i, j, strict=True))
            for i in combinations(range(len(t)), k)
            for j in permutations(range(len(p)), k)
        ]
        gated = min(ways, key=lambda w: sum(min(d[ij], trials.gate) for ij in w))
        gated = [ij for ij in gated if d[ij] < trials.gate]
        out["position_mean_mm"] += [d[ij] for ij in gated]
        out["position_ungated_mm"] += [
            d[ij] for ij in min(ways, key=lambda w: sum(d[ij] for ij in w))
        ]
        error = [p.depth[j] - t.depth[i] for i, j in gated]
        out["depth_mae_mm"] += [abs(e) for e in error]
        out["relative_depth_mae_mm"] += [abs(a - b) for a, b in combinations(error, 2)]
    return out


@pytest.mark.parametrize("source", ["kinds", "two_point"])
def test_against_a_search_of_all_assignments(source, request):
    trials = request.getfixturevalue(source)
    rows = score(NAMES, trials, rng=np.random.default_rng(0))
    for row in rows:
        expected = plain(trials, row.group)[row.metric]
        assert row.n == len(expected)
        assert row.value == pytest.approx(np.mean(expected))
        assert row.low < row.value < row.high
