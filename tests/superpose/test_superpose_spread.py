"""How far off answers are stated to be."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench_superpose import ErrorCauses, Spread, nominal_spread


def normal_of(std):
    return np.diag(1 / np.asarray(std, dtype=float).ravel() ** 2)


def with_terms(*rows):
    return Spread(np.array([rows] * 3, dtype=float))


def test_the_variance_is_the_sum_that_the_docstring_states():
    spread = with_terms([0.01, 2.0, 0.1, 1e-3], [0.02, 1.0, 0.2, 2e-3])
    fit = np.array([[0.01, 0.01, 0.5], [0.03, 0.03, 0.5]])
    shift = np.array([[0.3, 0.4, 0.0], [0.0, 0.0, 0.1]])
    std = spread.std(ErrorCauses.of(normal_of(fit), 7.0, shift))
    way, noise = np.array([0.5, 0.1]), fit[:, 0]
    plane = np.sqrt(0.01**2 + (2 * noise) ** 2 + (0.1 * way) ** 2 + 7e-3**2)
    depth = np.sqrt(0.02**2 + noise**2 + (0.2 * way) ** 2 + 14e-3**2)
    np.testing.assert_allclose(std, np.stack([plane, plane, depth], axis=1), rtol=1e-3)


def test_the_noise_is_that_of_correlated_unknowns():
    root = np.random.default_rng(0).normal(size=(3, 3))
    normal = 100 * (root @ root.T + np.eye(3))
    clues = ErrorCauses.of(normal, 0.5, np.zeros((1, 3)))
    variance = np.diagonal(np.linalg.inv(normal + np.eye(3) / 9))
    np.testing.assert_allclose(clues.noise, np.sqrt(variance[:2].mean()))


def test_one_contact_that_fits_badly_is_known_less_well_by_its_noise():
    good, bad = (ErrorCauses.of(normal_of([0.01] * 3), m, np.zeros((1, 3))) for m in (0.3, 4.0))
    np.testing.assert_allclose(bad.noise, 2 * good.noise)


def test_misfit_counts_as_correlated_where_sensors_vary():
    shift, normal = np.zeros((1, 3)), normal_of([0.01] * 3)
    plain, varied = (ErrorCauses.of(normal, 4.0, shift, varies) for varies in (False, True))
    np.testing.assert_allclose(varied.noise / plain.noise, np.sqrt(20 - 19 / 4))
    fitting = [ErrorCauses.of(normal, 0.8, shift, varies).noise for varies in (False, True)]
    np.testing.assert_array_equal(*fitting)


@pytest.mark.parametrize("normal", [np.zeros((6, 6)), np.ones((6, 6)), normal_of([[1e-9] * 3] * 2)])
def test_contacts_that_cannot_be_told_apart_are_no_error(normal):
    std = nominal_spread().std(ErrorCauses.of(normal, 1.0, np.zeros((2, 3))))
    assert std.shape == (2, 3)
    assert np.isfinite(std).all()
    assert (std >= 1e-4).all()
    assert (std <= 3.0).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_terms_that_made_the_errors_are_found_again(count):
    rng = np.random.default_rng(count)
    truth = with_terms([0.02, 3.0, 0.2 * (count > 1), 0.0], [0.01, 2.0, 0.1 * (count > 1), 0.0])
    clues, errors = [], []
    for _ in range(3000 // count):
        fit = np.repeat(rng.uniform(0.002, 0.03, (count, 1)), 3, axis=1)
        clue = ErrorCauses.of(normal_of(fit), 0.5, rng.uniform(0, 0.4, (count, 3)) * (count > 1))
        clues.append(clue)
        errors.append(truth.std(clue) * rng.standard_normal((count, 3)))
    fitted = nominal_spread().with_group(count, clues, errors)
    wanted = np.concatenate([truth.std(clue) for clue in clues])
    found = np.concatenate([fitted.std(clue) for clue in clues])
    np.testing.assert_allclose(found, wanted, rtol=0.2)
    z = np.concatenate(errors) / found
    assert 0.94 < np.mean(np.hypot(z[:, 0], z[:, 1]) < 2.447747) < 0.96
    assert 0.94 < np.mean(np.abs(z[:, 2]) < 1.959964) < 0.96


def test_few_errors_leave_the_terms_as_they_are():
    clue = ErrorCauses.of(normal_of([[0.01] * 3] * 2), 1.0, np.zeros((2, 3)))
    assert nominal_spread().with_group(2, [clue] * 5, [np.ones((2, 3))] * 5) is nominal_spread()
