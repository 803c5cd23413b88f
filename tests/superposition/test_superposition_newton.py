"""Contacts out of sums of fields: exact without noise, as sure as Cramer and Rao allow with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from tactibench.superposition import Field, cost_of, solve

# Far apart, so that the sum tells them from one another.
KNOWN = np.array([[-4.0, -3.5, 2.0], [4.0, -2.5, 3.5], [0.5, 4.5, 1.2]])


def summed(field, contacts):
    """(S, Q) for contacts (S, K, 3)."""
    return field(contacts).sum(axis=1)


def near(contacts, rng, way=0.5):
    return contacts + rng.uniform(-way, way, contacts.shape) * [1, 1, 0.6]


def jacobian(field, contacts, h=0.02):
    """(3 K, Q) by central differences."""
    rows = []
    for row in range(contacts.size):
        way = np.zeros(contacts.size)
        way[row] = h
        way = way.reshape(contacts.shape)
        rows.append((field(contacts + way) - field(contacts - way)).sum(axis=0) / (2 * h))
    return np.array(rows)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_contacts_are_recovered_from_their_sum(field, count):
    rng = np.random.default_rng(count)
    wanted = np.repeat(KNOWN[None, :count], 12, axis=0) + rng.uniform(-0.8, 0.8, (12, count, 3))
    moved = summed(field, wanted)
    found = solve(field, moved, near(wanted, rng), np.ones(moved.shape[1]))
    np.testing.assert_allclose(found.contacts, wanted, atol=1e-3)
    np.testing.assert_allclose(found.left, 0, atol=1e-3)


def test_the_answer_is_that_of_scipy(field):
    rng = np.random.default_rng(5)
    moved = summed(field, KNOWN[None, :2]) + 0.1 * rng.normal(size=(1, 122))
    weight = rng.uniform(0.2, 3, 122)
    start = near(KNOWN[:2], rng)

    def off(flat):
        return np.sqrt(weight) * (moved[0] - field(flat.reshape(-1, 3)).sum(axis=0))

    expected = least_squares(off, start.ravel(), diff_step=1e-4).x.reshape(-1, 3)
    found = solve(field, moved, start[None], weight)
    np.testing.assert_allclose(found.contacts[0], expected, atol=2e-3)


def test_errors_that_hang_together_are_weighed_together(field):
    rng = np.random.default_rng(6)
    mixing = np.eye(122) + 0.2 * rng.normal(size=(122, 122))
    covariance = mixing @ mixing.T
    moved = summed(field, KNOWN[None, :2]) + (mixing @ (0.05 * rng.normal(size=122)))
    start = near(KNOWN[:2], rng)
    precise = np.linalg.inv(covariance)
    root = np.linalg.cholesky(precise)

    def off(flat):
        left = moved[0] - field(flat.reshape(-1, 3)).sum(axis=0)
        return root.T @ left

    expected = least_squares(off, start.ravel(), diff_step=1e-4).x.reshape(-1, 3)
    whitener = np.linalg.inv(np.linalg.cholesky(covariance)).T
    found = solve(field, moved, start[None], np.ones(122), whitener=whitener)
    np.testing.assert_allclose(found.contacts[0], expected, atol=2e-3)
    left = moved[0] - summed(field, found.contacts)[0]
    np.testing.assert_allclose((found.left**2).sum(), left @ precise @ left, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2])
def test_noise_leaves_what_cramer_and_rao_allow(field, count):
    rng = np.random.default_rng(6)
    wanted, sigma, frames = KNOWN[:count], 0.02, 500
    moved = summed(field, wanted[None]) + sigma * rng.normal(size=(frames, 122))
    start = np.repeat(wanted[None], frames, axis=0)
    found = solve(field, moved, start, np.full(122, 1 / sigma**2))
    slopes = jacobian(field, wanted)
    bound = np.linalg.inv(slopes @ slopes.T) * sigma**2
    error = (found.contacts - wanted).reshape(frames, -1)
    scatter = error.T @ error / frames
    ratio = np.sqrt(np.diagonal(scatter) / np.diagonal(bound))
    np.testing.assert_allclose(ratio, 1, atol=4 / np.sqrt(2 * frames))
    # The whole matrix: the mean squared Mahalanobis length is the number of unknowns.
    lengths = np.einsum("fi,ij,fj->f", error, np.linalg.inv(bound), error)
    assert lengths.mean() == pytest.approx(3 * count, rel=0.15)
    assert np.abs(error.mean(axis=0) / np.sqrt(np.diagonal(bound) / frames)).max() < 4
    np.testing.assert_allclose(found.normal.mean(axis=0), np.linalg.inv(bound), rtol=0.05, atol=30)
    # chi^2 of what is left has Q - 3 K degrees of freedom.
    chi2 = ((found.left / sigma) ** 2).sum(axis=1)
    assert chi2.mean() == pytest.approx(122 - 3 * count, rel=0.02)


@given(
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    depth=st.floats(-5, 50),
    seed=st.integers(0, 100),
)
def test_answers_stay_on_the_lattice_and_never_get_worse(field, x, y, depth, seed):
    rng = np.random.default_rng(seed)
    moved = rng.normal(size=(1, 122))
    start = np.array([[[x, y, depth]]])
    none = solve(field, moved, start, np.ones(122), steps=0)
    found = solve(field, moved, start, np.ones(122))
    high = field.low + field.step * (np.array(field.coefficients.shape[:3]) - 1)
    for one in (none, found):
        assert (one.contacts >= field.low - 1e-12).all()
        assert (one.contacts <= high + 1e-12).all()
        assert (one.contacts[..., 2] > 0).all()
        assert np.isfinite(one.normal).all()
    assert (found.left**2).sum() <= (none.left**2).sum()


def shifted(moved, right, down):
    """The displacements in an image that has moved."""
    half = moved.shape[1] // 2
    return moved + np.repeat([right, down], half)


SHIFTS = np.repeat(np.eye(2), 61, axis=1)


def test_a_motion_of_the_image_is_found_beside_the_contacts(field):
    wanted = KNOWN[None, :2]
    moved = shifted(summed(field, wanted), 0.7, -0.3)
    weight = np.full(122, 1e4)
    start = near(wanted, np.random.default_rng(0))
    found = solve(field, moved, start, weight, motions=SHIFTS)
    np.testing.assert_allclose(found.contacts, wanted, atol=2e-3)
    np.testing.assert_allclose(found.nuisances, [[0.7, -0.3]], atol=2e-3)
    assert np.abs(solve(field, moved, start, weight).contacts - wanted).max() > 0.05


def test_information_is_what_is_left_when_the_motion_is_unknown(field):
    contact = KNOWN[None, :1]
    weight = np.full(122, 100.0)
    found = solve(field, summed(field, contact), contact, weight, motions=SHIFTS)
    slopes = np.concatenate([jacobian(field, found.contacts[0]), SHIFTS])
    whole = (slopes * weight) @ slopes.T + np.diag([0, 0, 0, 1, 1])
    expected = np.linalg.inv(np.linalg.inv(whole)[:3, :3])
    np.testing.assert_allclose(found.normal[0], expected, rtol=1e-2, atol=1e-3 * expected.max())


@pytest.fixture
def misfitting(field):
    """A frame that a field, whose size varies by a tenth, leaves unexplained by ten deviations."""
    size = np.concatenate([field.coefficients, 0.1 * field.coefficients], axis=-1)
    moved = shifted(1.3 * summed(field, KNOWN[None, :1]), 0.3, 0.0)
    moved += 0.1 * np.sin(np.arange(122) / 20)
    weight = np.full(122, 1e4)
    found = solve(
        Field(size, field.low, field.step, 1), moved, KNOWN[None, :1], weight, 40, motions=SHIFTS
    )
    return found, weight, float((weight * found.left**2).sum())


def test_the_numbers_of_a_sensor_are_held_more_than_a_motion(field, misfitting):
    found, weight, misfit = misfitting
    noise = misfit / 122
    assert noise > 3
    hold = noise * np.array([20 - 19 / noise, 1, 1])
    ways = np.concatenate([0.1 * summed(field, found.contacts), SHIFTS])
    # At the least cost every number stands between the misfit's pull and its hold.
    pull = ways @ (weight * found.left[0])
    np.testing.assert_allclose(pull, hold * found.nuisances[0], rtol=0.02, atol=0.02 * hold.max())


def test_the_cost_counts_numbers_in_units_of_the_misfit(misfitting):
    found, weight, misfit = misfitting
    noise = misfit / 122
    size, *motion = found.nuisances[0] ** 2
    expected = misfit + (20 * noise - 19) * size + noise * sum(motion)
    assert cost_of(found, weight, np.array([20.0, 1.0, 1.0])) == pytest.approx(expected)
