"""The field of single presses: an analytic one is found again; scipy and scikit-learn agree."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from tactibench import UserError
from tactibench.superposition import FEWEST, RIDGES, Field
from tactibench.superposition.field import _best_ridge, _spline

FEW = slice(None, None, 9)  # quantities that are enough, so that learning is quick


def ends(field):
    return field.low, field.low + field.step * (np.array(field.coefficients.shape[:3]) - 1)


def rms(values):
    return float(np.sqrt((values**2).mean()))


@pytest.fixture(scope="module")
def known(random_contacts, push_pins):
    """300 presses and 400 others, each with its values."""
    rng = np.random.default_rng(1)

    def _set(count):
        contacts = random_contacts(count, rng)
        return contacts, push_pins(contacts[:, None])[:, FEW]

    return _set(300), _set(400)


@pytest.fixture(scope="module")
def learned(known):
    return Field.learn(*known[0])


def test_an_analytic_field_is_found_again(known, learned):
    contacts, values = known[1]
    off = learned(contacts) - values
    # Away from the edge of the presses, and everywhere.
    inner = (np.abs(contacts[:, :2]) < 5.5).all(axis=1) & (contacts[:, 2] < 4.6)
    assert rms(values) > 0.3
    assert rms(off[inner]) < 0.002
    assert np.abs(off[inner]).max() < 0.02
    assert rms(off) < 0.01


def test_slopes_are_those_of_the_values(known, learned):
    contacts = known[1][0]
    slopes = learned.slopes(contacts)[:, :, 0]
    np.testing.assert_array_equal(slopes[:, 0], learned(contacts))
    h = 5e-3
    for axis in range(3):
        way = h * np.eye(3)[axis]
        central = (learned(contacts + way) - learned(contacts - way)) / (2 * h)
        np.testing.assert_allclose(slopes[:, 1 + axis], central, atol=2e-3)


def test_values_are_those_of_scipys_spline(learned):
    """scipy.ndimage evaluates the same coefficients, and fits the same ones to a lattice."""
    low, high = ends(learned)
    rng = np.random.default_rng(3)
    # The ends, too: there the spline goes on as its mirror image.
    places = np.concatenate([rng.uniform(low, high, (300, 3)), [low, high]])
    index = ((places - low) / learned.step).T.clip(0, None)
    for q in range(learned.coefficients.shape[-1]):
        expected = map_coordinates(
            learned.coefficients[..., q].astype(float), index, mode="mirror", prefilter=False
        )
        np.testing.assert_allclose(learned(places)[:, q], expected, atol=1e-5)

    lattice = rng.normal(size=(6, 5, 7, 2))
    field = Field(_spline(lattice), np.zeros(3), np.ones(3))
    inside = rng.uniform(0, [5, 4, 6], (200, 3))
    for q in range(2):
        expected = map_coordinates(lattice[..., q], inside.T, order=3, mode="mirror")
        np.testing.assert_allclose(field(inside)[:, q], expected, atol=1e-5)


def test_knots_hold_the_kriging_of_scikit_learn(random_contacts, push_pins):
    """Gaussian-process regression with one of the ridges, resting places included."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import Matern

    rng = np.random.default_rng(8)
    contacts = random_contacts(150, rng)
    values = push_pins(contacts[:, None])[:, ::40]
    values = values + 0.03 * rng.normal(size=values.shape)
    field = Field.learn(contacts, values)
    sides = [np.linspace(a, b, 7) for a, b in zip(*np.quantile(contacts, [0, 1], 0), strict=True)]
    x, y = (axis.ravel() for axis in np.meshgrid(*sides[:2]))
    resting = np.stack([x, y, 0 * x], axis=1)
    nodes = field.low + field.step * rng.integers(0, field.coefficients.shape[:3], (200, 3))
    process = GaussianProcessRegressor(
        Matern(30.0, nu=2.5),
        alpha=_best_ridge(contacts, values, np.ones((len(contacts), 1))),
        optimizer=None,
    )
    process.fit(
        np.concatenate([contacts, resting]),
        np.concatenate([values, np.zeros((49, values.shape[1]))]),
    )
    np.testing.assert_allclose(field(nodes), process.predict(nodes), atol=1e-4)


def test_noise_is_smoothed(known):
    (contacts, values), (others, expected) = known
    rng = np.random.default_rng(4)
    ridges, errors = [], []
    for sigma in (0.0, 0.02, 0.2):
        noisy = values + sigma * rng.normal(size=values.shape)
        ridges.append(_best_ridge(contacts, noisy, np.ones((len(contacts), 1))))
        errors.append(rms(Field.learn(contacts, noisy)(others) - expected))
    assert set(ridges) <= set(RIDGES)
    assert ridges[0] < ridges[1] < ridges[2]
    assert errors[0] < 0.01
    # The field knows less than half of the noise of one press.
    assert errors[1] < 0.7 * 0.02
    assert errors[2] < 0.5 * 0.2


@given(
    place=st.tuples(st.floats(-6.5, 6.5), st.floats(-6.5, 6.5), st.floats(0.5, 5.5)),
    axis=st.integers(0, 2),
    beyond=st.floats(0, 1e3),
    side=st.integers(0, 1),
)
def test_beyond_the_lattice_its_edge_holds(learned, place, axis, beyond, side):
    edge = np.array(place)
    edge[axis] = ends(learned)[side][axis]
    outside = edge.copy()
    outside[axis] += (2 * side - 1) * beyond
    np.testing.assert_allclose(learned(outside), learned(edge), atol=1e-6)


@pytest.mark.parametrize("count", [0, FEWEST - 1])
def test_too_few_presses_are_refused(known, count):
    contacts, values = known[0]
    with pytest.raises(UserError, match=f"{count} presses") as caught:
        Field.learn(contacts[:count], values[:count])
    assert str(FEWEST) in str(caught.value)
