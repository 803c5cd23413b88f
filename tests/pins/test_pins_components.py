"""Components of displacements against numpy's own decomposition, and the median regression."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench_pins import (
    Components,
    Features,
    Setting,
    choose_setting,
    kernel,
    kernel_weights,
)


def moved(count=60, pins=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 3)) * [5, 2, 0.5] @ rng.normal(size=(3, 2 * pins)) + 1


def test_components_are_those_of_the_singular_values():
    frames = moved()
    components = Components.fit(frames, 3)
    _, values, rows = np.linalg.svd(frames - frames.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(components.spread, values[:3] / np.sqrt(len(frames)))
    np.testing.assert_allclose(np.abs(rows[:3] @ components.basis), np.eye(3), atol=1e-9)
    assert len(components.first(2)) == 2


def test_no_more_components_than_there_are():
    assert len(Components.fit(moved(), 9)) == 3
    assert len(Components.fit(np.ones((4, 6)), 3)) == 1


@given(st.floats(0, 1))
def test_whitening_is_a_power_of_the_spread(whitening):
    frames = moved()
    components = Components.fit(frames, 3)
    spread = components.of(frames, whitening).std(axis=0)
    relative = (components.spread / components.spread[0]) ** (1 - whitening)
    np.testing.assert_allclose(spread, relative, rtol=1e-6)


def test_least_squares_is_the_closed_form():
    rng = np.random.default_rng(1)
    places, target = rng.normal(size=(20, 2)), rng.normal(size=(20, 1))
    gram = kernel(places, places, 1.3)
    by_hand = np.exp(-((places[:, None] - places) ** 2).sum(axis=-1) / (2 * 1.3**2))
    np.testing.assert_allclose(gram, by_hand)
    alpha = kernel_weights(gram, target, Setting(ridge=0.1, rounds=0))
    np.testing.assert_allclose((gram + 0.1 * np.eye(20)) @ alpha, target)


def test_reweighting_forgives_a_third_of_wrong_targets():
    """When values are 0 and three in ten are 1, the median is 0 and the mean 0.3."""
    x = np.linspace(-1, 1, 200)[:, None]
    wrong = (np.random.default_rng(2).random(200) < 0.3).astype(float)[:, None]
    gram = kernel(x, x, 2.0)
    plain = gram @ kernel_weights(gram, wrong, Setting(ridge=1.0, rounds=0))
    median = gram @ kernel_weights(gram, wrong, Setting(ridge=1.0, rounds=8))
    assert plain.mean() == pytest.approx(wrong.mean(), abs=0.02)
    assert np.abs(median).mean() < 0.1


def test_the_best_setting_is_no_worse_than_the_usual_one():
    frames = moved(120, seed=3)
    components = Components.fit(frames, 3)
    targets = np.sin(components.of(frames, 0.5)[:, :2])
    learned = Features(components, frames[:80], targets[:80])

    def error(setting):
        own, length = learned.places(setting)
        alpha = kernel_weights(kernel(own, own, length), learned.targets, setting)
        places, _ = learned.places(setting, frames[80:])
        return np.abs(kernel(places, own, length) @ alpha - targets[80:]).mean()

    chosen = choose_setting(learned, frames[80:], targets[80:])
    assert error(chosen) <= error(Setting())
