"""Contacts read from anchors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench.training import read_mixture


def anchors(*rows):
    """One frame of (p, x, y, depth) with std 0.1."""
    values = np.array(rows, dtype=float).reshape(1, -1, 4)
    return values[..., 0], values[..., 1:], np.full((*values.shape[:2], 3), 0.1)


def one_by_one(p, mean, std, threshold=0.5, merge=2.0):
    """The rule in plain loops: [(score, mean, std)] of one frame, best first."""
    left = [m for m in range(len(p)) if p[m] >= 0.01]
    found = []
    while left:
        first = max(left, key=lambda m: p[m])
        group = [m for m in left if np.linalg.norm(mean[m, :2] - mean[first, :2]) <= merge]
        left = [m for m in left if m not in group]
        total = p[group].sum()
        if total >= threshold:
            share = p[group] / total
            centre = share @ mean[group]
            second = share @ (std[group] ** 2 + mean[group] ** 2)
            found.append((min(total, 1.0), centre, np.sqrt(second - centre**2)))
    return sorted(found, key=lambda row: -row[0])


def test_an_anchor_is_a_contact_with_its_own_values():
    (found,) = read_mixture(*anchors((0.9, 1, 2, 3)))
    assert found.xy.tolist() == [[1, 2]]
    assert found.depth.tolist() == [3]
    assert found.score.tolist() == [0.9]
    np.testing.assert_allclose(found.std, 0.1)


def test_neighbours_that_share_a_contact_are_merged():
    (found,) = read_mixture(*anchors((0.4, 1.0, 2, 3), (0.3, 1.2, 2, 3), (0.2, 1.1, 2.1, 3.1)))
    assert len(found) == 1
    assert found.score[0] == pytest.approx(0.9)
    assert found.xy[0, 0] == pytest.approx((0.4 + 0.36 + 0.22) / 0.9)
    assert (found.std > 0.1).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 40))
@settings(max_examples=60, deadline=None)
def test_it_is_the_rule_written_as_loops(seed, frames, count):
    rng = np.random.default_rng(seed)
    p = rng.uniform(0, 1, (frames, count)) ** rng.integers(1, 6)
    mean, std = rng.uniform(-6, 6, (frames, count, 3)), rng.uniform(0.01, 1, (frames, count, 3))
    found = read_mixture(p, mean, std, max_count=100)
    for i in range(frames):
        expected = one_by_one(p[i], mean[i], std[i])
        assert len(found[i]) == len(expected)
        for j in range(len(expected)):
            score, centre, spread = expected[j]
            assert found[i].score[j] == pytest.approx(score)
            if np.count_nonzero(found[i].score == found[i].score[j]) == 1:
                np.testing.assert_allclose([*found[i].xy[j], found[i].depth[j]], centre)
                np.testing.assert_allclose(found[i].std[j], spread, rtol=1e-6)


def test_frames_are_read_one_by_one_as_together():
    rng = np.random.default_rng(3)
    p, mean, std = rng.uniform(0, 1, (5, 9)), rng.normal(0, 4, (5, 9, 3)), np.ones((5, 9, 3))
    for i, found in enumerate(read_mixture(p, mean, std)):
        (alone,) = read_mixture(p[i : i + 1], mean[i : i + 1], std[i : i + 1])
        np.testing.assert_allclose(alone.xy, found.xy)


def test_at_most_max_count_contacts_are_returned():
    (found,) = read_mixture(*anchors(*((0.9 - k / 100, 5 * k, 0, 1) for k in range(9))))
    assert len(found) == 6
    assert found.score[0] == 0.9


@pytest.mark.parametrize("shape", [(0, 4), (3, 0), (3, 4)])
def test_nothing_present_gives_no_contacts(shape):
    found = read_mixture(np.zeros(shape), np.zeros((*shape, 3)), np.ones((*shape, 3)))
    assert [len(contacts) for contacts in found] == [0] * shape[0]


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"\(2, 3\)"):
        read_mixture(np.zeros((2, 3)), np.zeros((2, 3, 2)), np.zeros((2, 3, 3)))


def test_values_that_are_not_finite_are_refused():
    p, mean, std = anchors((0.9, 1, 2, np.nan))
    with pytest.raises(ValueError, match="not finite"):
        read_mixture(p, mean, std)
