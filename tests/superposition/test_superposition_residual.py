"""What a law leaves of pairs is learned, in any direction and in the mirror."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench.superposition import Residual

FLIP = np.array([1.0, -1.0, 1.0])


def some_pairs(count: int, seed: int) -> np.ndarray:
    """(S, 2, 3) mm, 7 to 11 mm apart in any direction."""
    rng = np.random.default_rng(seed)
    turn, apart = rng.uniform(0, 2 * np.pi, count), rng.uniform(7, 11, count)
    half = 0.5 * apart[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    centre = rng.uniform(-1.5, 1.5, (count, 2))
    xy = np.stack([centre - half, centre + half], axis=1)
    return np.concatenate([xy, rng.uniform(1, 5, (count, 2, 1))], axis=2)


def left_of(pairs: np.ndarray) -> np.ndarray:
    """A remainder that turns with the pair: towards the other, beside it, and in depth."""
    apart = pairs[:, ::-1, :2] - pairs[:, :, :2]
    distance = np.linalg.norm(apart, axis=-1, keepdims=True)
    towards = apart / distance
    beside = np.stack([-towards[..., 1], towards[..., 0]], axis=-1)
    place = (pairs[..., :2] * beside).sum(axis=-1, keepdims=True)
    own, other = pairs[..., 2:], pairs[:, ::-1, 2:]
    xy = 0.03 * np.sin(distance) * towards + 0.01 * place * beside
    return np.concatenate([xy, 0.02 * np.cos(own) * other / 5], axis=-1)


@pytest.fixture(scope="module")
def learned() -> Residual:
    pairs = some_pairs(400, 0)
    noise = 0.002 * np.random.default_rng(1).normal(size=pairs.shape)
    return Residual.learn(pairs, left_of(pairs) + noise)


def test_new_pairs_are_foretold(learned) -> None:
    pairs = some_pairs(200, 2)
    wanted = left_of(pairs)
    off = learned.shift(pairs) - wanted
    assert np.sqrt((off**2).mean()) < 0.3 * np.sqrt((wanted**2).mean())


def test_turned_and_mirrored_pairs_have_turned_and_mirrored_remainders(learned) -> None:
    pairs = some_pairs(20, 3)
    shift = learned.shift(pairs)
    np.testing.assert_allclose(learned.shift(pairs * FLIP), shift * FLIP, atol=1e-9)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(learned.shift(pairs @ turn.T), shift @ turn.T, atol=1e-9)
    np.testing.assert_allclose(learned.shift(pairs[:, ::-1]), shift[:, ::-1], atol=1e-9)


def test_a_pair_that_was_seen_wrongly_does_no_harm(learned) -> None:
    pairs = some_pairs(400, 0)
    left = left_of(pairs) + 0.002 * np.random.default_rng(1).normal(size=pairs.shape)
    left[::40] += 3.0
    spoilt = Residual.learn(pairs, left)
    asked = some_pairs(100, 4)
    np.testing.assert_allclose(spoilt.shift(asked), learned.shift(asked), atol=0.01)


@pytest.mark.parametrize("count", [1, 3])
def test_other_numbers_of_contacts_have_none(learned, count) -> None:
    contacts = np.ones((4, count, 3))
    np.testing.assert_array_equal(learned.shift(contacts), 0 * contacts)


def test_too_few_pairs_teach_nothing() -> None:
    pairs = some_pairs(50, 5)
    nothing = Residual.learn(pairs, left_of(pairs))
    assert len(nothing.features) == 0
    np.testing.assert_array_equal(nothing.shift(pairs), 0 * pairs)


@pytest.mark.long
def test_pairs_unlike_all_that_were_learned_from_have_none(learned) -> None:
    level, uneven = some_pairs(400, 5), some_pairs(200, 6)
    level[:, 1, 2] = level[:, 0, 2]
    uneven[:, 0, 2], uneven[:, 1, 2] = 1.0, 5.5
    noise = 0.002 * np.random.default_rng(1).normal(size=level.shape)
    of_level = Residual.learn(level, left_of(level) + noise)
    assert np.abs(of_level.shift(level) - left_of(level)).mean() < 0.004
    usual = np.sqrt(np.square(left_of(level)).mean())
    assert np.sqrt(np.square(of_level.shift(uneven)).mean()) < 0.5 * usual
