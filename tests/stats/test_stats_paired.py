"""Paired differences, permutation p, Holm, rank groups."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tactibench.stats.paired import (
    grouped,
    holm,
    paired_difference,
    rank_groups,
    sign_flip_p,
    sign_flip_ps,
)


def test_interval_is_the_paired_t_interval():
    rng = np.random.default_rng(0)
    a = rng.normal(1, 2, 30)
    b = a + rng.normal(0.3, 0.5, 30)
    found = paired_difference(a, b, rng=rng)
    expected = stats.ttest_rel(a, b).confidence_interval(0.95)
    assert (found.difference.low, found.difference.high) == pytest.approx(tuple(expected))
    assert found.p == pytest.approx(stats.ttest_rel(a, b).pvalue, abs=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_p_against_all_sign_flips(seed):
    rng = np.random.default_rng(seed)
    d = rng.normal(0.4, 1, 10)
    sums = np.array([abs(np.dot(s, d)) for s in product([-1, 1], repeat=10)])
    exact = np.mean(sums >= abs(d.sum()) - 1e-12)
    assert sign_flip_p(d, rng=rng, permutations=40_000) == pytest.approx(exact, abs=0.01)


def test_p_is_never_nought_and_one_for_no_difference():
    rng = np.random.default_rng(4)
    assert sign_flip_p(np.ones(60), rng=rng, permutations=999) == 1 / 1000
    assert sign_flip_p(np.zeros(60), rng=rng, permutations=999) == 1
    # rounding must not hide the flips that tie with the data: 2 of 4 here
    assert sign_flip_p([0.1, 0.1], rng=rng, permutations=9999) == pytest.approx(0.5, abs=0.03)


def test_p_is_uniform_under_the_null():
    rng = np.random.default_rng(5)
    p = [sign_flip_p(rng.normal(size=20), rng=rng, permutations=199) for _ in range(600)]
    assert np.mean(np.array(p) <= 0.05) == pytest.approx(0.05, abs=0.025)
    assert np.mean(p) == pytest.approx(0.5, abs=0.04)


def test_one_press_has_a_difference_and_nothing_else():
    found = paired_difference([1.0], [0.4], rng=np.random.default_rng(0))
    assert found.difference.value == pytest.approx(0.6)
    assert (found.difference.low, found.p) == (None, None)


def test_bad_pairs_are_refused():
    with pytest.raises(ValueError, match="shapes"):
        paired_difference([1.0, 2.0], [1.0], rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="second: 1 of 2"):
        paired_difference([1.0, 2.0], [1.0, np.nan], rng=np.random.default_rng(0))


def holm_by_definition(p):
    """Adjusted p = smallest level at which the step-down procedure rejects."""
    order = sorted(range(len(p)), key=lambda i: p[i])
    out = [0.0] * len(p)
    for place, i in enumerate(order):
        steps = [(len(p) - k) * p[order[k]] for k in range(place + 1)]
        out[i] = min(1.0, max(steps))
    return out


@settings(max_examples=60)
@given(st.lists(st.floats(0, 1), max_size=8))
def test_holm_by_its_definition(p):
    assert holm(p) == pytest.approx(holm_by_definition(p))


def test_holm_of_the_textbook_case():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_ranks_are_groups():
    rng = np.random.default_rng(6)
    press = rng.normal(0, 5, 200)  # shared difficulty: only pairing can see through it
    table = np.stack([press + offset + rng.normal(0, 0.2, 200) for offset in (3, 0, 0.005, 1)])
    assert rank_groups(table) == [4, 1, 1, 3]
    assert rank_groups(-table, better="higher") == [4, 1, 1, 3]
    assert rank_groups(np.zeros((3, 5))) == [1, 1, 1]
    assert rank_groups(table[:, :1]) == [1, 1, 1, 1]
    with pytest.raises(ValueError, match="'lower' or 'higher'"):
        rank_groups(table, better="none")


def test_columns_share_their_signs_and_have_the_p_of_each_alone():
    d = np.random.default_rng(7).normal(0.3, 1, (25, 3))
    together = sign_flip_ps(d, rng=np.random.default_rng(8), permutations=999)
    alone = [sign_flip_p(c, rng=np.random.default_rng(8), permutations=999) for c in d.T]
    assert together == alone
    with pytest.raises(ValueError, match=r"shape \(25,\)"):
        sign_flip_ps(d[:, 0], rng=np.random.default_rng(0))


def test_a_press_without_a_difference_changes_no_p():
    d = np.random.default_rng(9).normal(0.4, 1, 12)
    padded = np.concatenate([d, np.zeros(40)])[:, None]
    found = sign_flip_ps(padded, rng=np.random.default_rng(1), permutations=20_000)[0]
    alone = sign_flip_p(d, rng=np.random.default_rng(2), permutations=20_000)
    assert found == pytest.approx(alone, abs=0.012)


def test_groups_need_not_be_neighbours():
    worse = {(1, 0), (3, 1)}
    assert grouped([0, 1, 2, 3], lambda m, best: (m, best) in worse) == {0: 1, 2: 1, 3: 1, 1: 4}
    assert grouped([], lambda *_: True) == {}
