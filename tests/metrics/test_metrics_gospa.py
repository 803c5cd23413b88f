"""GOSPA: brute force, metric properties, and what an omission costs."""

from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.metrics.detection import gospa
from tactibench.metrics.registry import score

GATE = 3.0


def rng():
    return np.random.default_rng(0)


def brute(truth, predicted, p):
    """Every subset of pairs, paired in every order; alpha = 2."""
    costs = []
    for k in range(min(len(truth), len(predicted)) + 1):
        for i in combinations(range(len(truth)), k):
            for j in permutations(range(len(predicted)), k):
                d = np.linalg.norm(truth[list(i)] - predicted[list(j)], axis=1)
                unpaired = len(truth) + len(predicted) - 2 * k
                costs.append((d**p).sum() + GATE**p / 2 * unpaired)
    return min(costs) ** (1 / p)


def points(axes):
    """Return (N, axes) points, N from 0 to 4."""
    return st.tuples(st.integers(0, 4), st.integers(0, 2**32 - 1)).map(
        lambda a: np.random.default_rng(a[1]).uniform(-4, 4, (a[0], axes))
    )


pairs_of_sets = st.integers(1, 3).flatmap(lambda axes: st.tuples(points(axes), points(axes)))
power = st.sampled_from([1, 2])


@settings(max_examples=60, deadline=None)
@given(pairs_of_sets, power)
def test_against_brute_force(sets, p):
    truth, predicted = sets
    assert gospa(truth, predicted, GATE, p) == pytest.approx(brute(truth, predicted, p))


@settings(max_examples=60, deadline=None)
@given(points(2), points(2), power, st.integers(0, 2**32 - 1))
def test_losing_a_partner_or_making_one_up_never_improves(truth, predicted, p, seed):
    base = gospa(truth, predicted, GATE, p)
    far = np.vstack([predicted, [[100.0, 100.0]]])
    assert gospa(truth, far, GATE, p) > base
    more_truth = np.vstack([truth, [[100.0, 100.0]]])
    assert gospa(more_truth, predicted, GATE, p) > base
    # a perfect answer that loses a contact pays half a gate for it
    if len(truth):
        lost = np.delete(truth, np.random.default_rng(seed).integers(len(truth)), axis=0)
        assert gospa(truth, lost, GATE, p) == pytest.approx((GATE**p / 2) ** (1 / p))


def test_rows_are_means_over_frames(kinds):
    rows = score(["gospa1_mm", "gospa2_mm"], kinds, rng=np.random.default_rng(0))
    for row in rows:
        frames = [i for i, g in enumerate(kinds.group) if row.group in ("all", g)]
        each = [
            brute(kinds.truth[i].xy, kinds.predictions[i].xy, int(row.metric[5])) for i in frames
        ]
        assert row.value == pytest.approx(np.mean(each))
        assert (row.n, row.clusters) == (len(frames), len(frames) // 3)


def test_depth_counts_as_much_as_place_where_it_is_known(kinds):
    def place(contacts):
        return np.column_stack([contacts.xy, contacts.depth])

    (row,) = (r for r in score(["gospa_depth_mm"], kinds, rng=rng()) if r.group == "all")
    pairs = list(zip(kinds.truth, kinds.predictions, strict=True))
    each = [brute(place(true), place(seen), 1) for true, seen in pairs]
    assert row.value == pytest.approx(np.mean(each))
    blind = replace(kinds, truth=tuple(replace(t, depth=t.depth + np.nan) for t in kinds.truth))
    plane, both = (score([name], blind, rng=rng()) for name in ("gospa1_mm", "gospa_depth_mm"))
    assert [row.value for row in both] == [row.value for row in plane]


def test_an_infinite_gate_is_refused(make_trials):
    trials = make_trials(np.random.default_rng(0), ["dual"] * 4, gate=np.inf)
    with pytest.raises(UserError, match="finite gate"):
        score(["gospa1_mm"], trials, rng=np.random.default_rng(0))
