"""Permutation p, Holm's adjustment, groups of equal rank."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench.stats import holm, sign_flip_ps


def p_of(differences, **options):
    return sign_flip_ps(np.asarray(differences)[:, None], **options)[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_p_against_all_sign_flips(seed):
    rng = np.random.default_rng(seed)
    d = rng.normal(0.4, 1, 10)
    sums = np.array([abs(np.dot(s, d)) for s in product([-1, 1], repeat=10)])
    exact = np.mean(sums >= abs(d.sum()) - 1e-12)
    assert p_of(d, rng=rng, permutations=40_000) == pytest.approx(exact, abs=0.01)


def test_p_is_never_nought_and_one_for_no_difference():
    rng = np.random.default_rng(4)
    assert p_of(np.ones(60), rng=rng, permutations=999) == 1 / 1000
    assert p_of(np.zeros(60), rng=rng, permutations=999) == 1
    # rounding must not hide the flips that tie with the data: 2 of 4 here
    assert p_of([0.1, 0.1], rng=rng, permutations=9999) == pytest.approx(0.5, abs=0.03)


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


def test_columns_share_their_signs_and_have_the_p_of_each_alone():
    d = np.random.default_rng(7).normal(0.3, 1, (25, 3))
    together = sign_flip_ps(d, rng=np.random.default_rng(8), permutations=999)
    alone = [p_of(c, rng=np.random.default_rng(8), permutations=999) for c in d.T]
    assert together == alone


def test_a_press_without_a_difference_changes_no_p():
    d = np.random.default_rng(9).normal(0.4, 1, 12)
    padded = np.concatenate([d, np.zeros(40)])[:, None]
    found = sign_flip_ps(padded, rng=np.random.default_rng(1), permutations=20_000)[0]
    alone = p_of(d, rng=np.random.default_rng(2), permutations=20_000)
    assert found == pytest.approx(alone, abs=0.012)
