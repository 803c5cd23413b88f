"""The assignment against a search of all assignments."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench.contacts import Contacts
from tactibench.metrics import match, match_trials, runs


def best_cost(truth, predicted, gate, power=1):
    """Smallest sum of min(d, gate)^p over all ways to pair, every unpaired pair costs the gate."""
    short, long = sorted((truth, predicted), key=len)
    d = np.linalg.norm(short[:, None] - long[None], axis=-1)
    d = np.minimum(d, gate) ** power
    orders = permutations(range(len(long)), len(short))
    return min(sum(d[i, j] for i, j in enumerate(order)) for order in orders)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 10**6), st.sampled_from([1, 2]))
def test_assignment_is_the_cheapest_of_all(k, m, seed, power):
    rng = np.random.default_rng(seed)
    truth, predicted = rng.uniform(-4, 4, (k, 2)), rng.uniform(-4, 4, (m, 2))
    rows, columns, distance = match(truth, predicted, 3.0, power)
    assert len(set(rows)) == len(rows)
    assert len(set(columns)) == len(columns)
    assert (distance < 3.0).all()
    np.testing.assert_allclose(distance, np.linalg.norm(truth[rows] - predicted[columns], axis=1))
    cost = (distance**power).sum() + 3.0**power * (min(k, m) - len(distance))
    assert cost == pytest.approx(best_cost(truth, predicted, 3.0, power))


def test_a_cheap_pair_is_preferred_to_two_dear_ones():
    truth = np.array([[0.0, 0.0], [2.9, 0.0]])
    predicted = np.array([[0.1, 0.0], [-2.85, 0.0]])
    rows, columns, _ = match(truth, predicted, 3.0)
    assert (list(rows), list(columns)) == ([0], [0])


@pytest.mark.parametrize(("offset", "count"), [(2.999, 1), (3.0, 0), (3.001, 0)])
def test_the_gate_is_open_at_its_end(offset, count):
    rows, _, _ = match(np.zeros((1, 2)), np.array([[offset, 0.0]]), 3.0)
    assert len(rows) == count


def test_no_trials_and_no_contacts_give_empty_tables():
    assert len(match_trials([], [], 3.0).trial) == 0
    empty = match_trials([Contacts.none()] * 2, [Contacts.none()] * 2, 3.0)
    assert empty.true_xy.shape == (0, 2)
    assert list(empty.per_trial(2)) == [0, 0]


def test_runs_walk_through_the_trials_that_occur():
    found = list(runs(np.array([1, 1, 4, 7, 7, 7])))
    assert found == [(1, slice(0, 2)), (4, slice(2, 3)), (7, slice(3, 6))]
