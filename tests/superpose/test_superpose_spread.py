"""How far off answers are said to be."""

import numpy as np
import pytest

from tactibench_superpose.spread import Spread, law_errors, noise_factors

LAW = np.array([[0.4, 0.4, 0.3], [0.8, 0.8, 0.6]])


def normal_of(std):
    return np.diag(1 / np.asarray(std, dtype=float).ravel() ** 2)


def test_one_contact_has_the_std_of_the_fit():
    spread = Spread(np.ones(3), LAW)
    std = spread.std(normal_of([0.01, 0.02, 0.03]), 90.0, 100, np.zeros((1, 3)))
    np.testing.assert_allclose(std, [[0.01, 0.02, 0.03]])


def test_a_frame_that_fits_badly_is_known_less_well():
    spread = Spread(np.ones(3), LAW)
    std = spread.std(normal_of([0.01, 0.02, 0.03]), 400.0, 100, np.zeros((1, 3)))
    np.testing.assert_allclose(std, 2 * np.array([[0.01, 0.02, 0.03]]))


def test_factors_stretch_every_axis():
    spread = Spread(np.array([1.0, 2.0, 3.0]), LAW)
    std = spread.std(normal_of([0.01, 0.01, 0.01]), 0.0, 100, np.zeros((1, 3)))
    np.testing.assert_allclose(std, [[0.01, 0.02, 0.03]])


@pytest.mark.parametrize(("count", "row"), [(2, 0), (3, 1), (5, 1)])
def test_several_contacts_carry_the_error_of_their_law(count, row):
    spread = Spread(np.ones(3), LAW)
    fit = np.linspace(0.01, 0.05, 3 * count).reshape(count, 3)
    shift = np.zeros((count, 3))
    shift[0] = [0.3, 0.4, 0.0]
    # chi^2 says nothing more: the law's error is in it.
    std = spread.std(normal_of(fit), 1e4, 100, shift)
    way = np.array([0.55] + [0.05] * (count - 1))[:, None]
    np.testing.assert_allclose(std, np.hypot(fit, LAW[row] * way))


def test_contacts_that_cannot_be_told_apart_are_no_error():
    spread = Spread(np.ones(3), LAW)
    for normal in (np.zeros((6, 6)), np.ones((6, 6)), normal_of([[1e-9] * 3] * 2)):
        std = spread.std(normal, 1.0, 0, np.zeros((2, 3)))
        assert std.shape == (2, 3)
        assert np.isfinite(std).all()
        assert (std >= 1e-4).all()


def test_the_std_is_that_of_correlated_unknowns():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    normal = root @ root.T + np.eye(3)
    std = Spread(np.ones(3), LAW).std(normal, 0.0, 9, np.zeros((1, 3)))
    np.testing.assert_allclose(std[0], np.sqrt(np.diagonal(np.linalg.inv(normal))))


def test_noise_factors_are_found_again():
    rng = np.random.default_rng(1)
    std = rng.uniform(0.01, 0.1, (20_000, 3))
    error = std * rng.normal(size=std.shape) * [0.5, 1.0, 2.0]
    np.testing.assert_allclose(noise_factors(error, std), [0.5, 1.0, 2.0], rtol=0.03)
    np.testing.assert_array_equal(noise_factors(error[:0], std[:0]), np.ones(3))


def test_law_errors_are_found_again_and_x_and_y_are_alike():
    rng = np.random.default_rng(2)
    shift = rng.uniform(-0.5, 0.5, (8000, 2, 3))
    way = np.linalg.norm(shift, axis=-1, keepdims=True) + 0.05
    error = way * rng.normal(size=shift.shape) * [0.3, 0.3, 0.1]
    np.testing.assert_allclose(law_errors(shift, error), [0.3, 0.3, 0.1], rtol=0.03)
    # As the model reads them: 95 % within 1.96.
    spread = Spread(np.ones(3), np.stack([law_errors(shift, error)] * 2))
    std = np.stack([spread.std(normal_of([[1e-5] * 3] * 2), 0, 9, one) for one in shift[:2000]])
    assert (np.abs(error[:2000]) < 1.96 * std).mean() == pytest.approx(0.95, abs=0.01)
    uneven = law_errors(shift, error * [2, 0.5, 1])
    assert uneven[0] == uneven[1]
