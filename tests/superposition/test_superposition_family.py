"""Fields of sensors that differ: learned together, and told by rest frames and few presses."""

import numpy as np
import pytest

from tactibench.superposition import Field, FieldFamily, evidence, solve

pytestmark = pytest.mark.long

SENSORS, PRESSES = 24, 30
SIGMA = 0.01  # px


def sensor(number):
    """Size and stretch of a sensor; the size is seen at rest, the stretch is not."""
    return np.random.default_rng([5, number]).uniform(-1, 1, 2) * [0.4, 0.15]


def displacements(push_pins, contacts, number):
    """(N, Q) px: the size acts like depth, the stretch on what moves along x."""
    size, stretch = sensor(number)
    noise = SIGMA * np.random.default_rng([6, number]).normal(size=(len(contacts), 122))
    plain, deeper = (push_pins(contacts[:, None] * [1, 1, d]) for d in (1.0, 1.3))
    return plain * np.repeat([1 + stretch, 1.0], 61) + size * (deeper - plain) + noise


@pytest.fixture(scope="module")
def family(random_contacts, push_pins):
    contacts = random_contacts(SENSORS * PRESSES, np.random.default_rng(0))
    numbers = np.repeat(np.arange(SENSORS), PRESSES)
    rows = [numbers == number for number in range(SENSORS)]
    values = [displacements(push_pins, contacts[own], n) for n, own in enumerate(rows)]
    return FieldFamily.learn(contacts, np.concatenate(values), numbers, rests(range(SENSORS)), 61)


def rests(numbers):
    """(S, 1 + Q): the size, and pins that differ by it."""
    shape = np.sin(np.arange(122))
    return np.array([np.append(sensor(n)[0], 0.3 * sensor(n)[0] * shape) for n in numbers])


@pytest.fixture(scope="module")
def unseen(random_contacts, push_pins):
    """Contacts and displacements on a sensor that is in no training."""
    contacts = random_contacts(60, np.random.default_rng(1))
    return contacts, displacements(push_pins, contacts, 100)


def misfit(field, unseen):
    return float(np.sqrt(np.mean((field(unseen[0]) - unseen[1]) ** 2)))


@pytest.mark.long
def test_what_is_known_of_a_sensor_brings_its_field_nearer(family, unseen, push_pins):
    mean, seen, shown = [], [], []
    contacts = unseen[0]
    for number in range(100, 110):
        own, rest = displacements(push_pins, contacts, number), rests([number])[0]
        mean.append(misfit(family.field, (contacts, own)))
        seen.append(misfit(family.of_sensor(rest), (contacts, own)))
        shown.append(misfit(family.of_sensor(rest, contacts[:10], own[:10]), (contacts, own)))
    mean, seen, shown = np.mean(mean), np.mean(seen), np.mean(shown)
    assert seen < 0.8 * mean
    assert shown < 0.75 * seen
    assert shown < 3 * SIGMA


def test_one_sensor_has_one_field(random_contacts, push_pins):
    contacts = random_contacts(60, np.random.default_rng(2))
    values = push_pins(contacts[:, None])
    alone = FieldFamily.learn(contacts, values, np.zeros(60, dtype=int), np.zeros((1, 123)), 61)
    assert alone.field.ways == 0
    own = alone.of_sensor(np.ones(123), contacts, values)
    np.testing.assert_array_equal(own.coefficients, Field.learn(contacts, values).coefficients)


def rubbing(push_pins, contacts, y):
    """(N, Q) px: the skin follows by y along the way that leads away from the axis."""
    noise = SIGMA * np.random.default_rng(7).normal(size=(len(contacts), 122))
    pull = 0.01 * (y * contacts[:, 2])[:, None] * contacts[:, :2]
    return push_pins(contacts[:, None]) + np.repeat(pull, 61, axis=1) + noise


def learn(contacts, values):
    return FieldFamily.learn(
        contacts, values, np.zeros(len(values), dtype=int), np.zeros((1, 123)), 61
    )


def test_presses_that_rub_have_a_number_each(random_contacts, push_pins):
    rng = np.random.default_rng(8)
    contacts, y = random_contacts(400, rng), rng.normal(size=400)
    values = rubbing(push_pins, contacts, y)
    family = learn(contacts[:300], values[:300])
    assert family.field.ways == 1
    left = family.field.residual(contacts[300:], values[300:])
    plain = learn(contacts[:300], rubbing(push_pins, contacts, 0 * y)[:300])
    assert plain.field.ways == 0
    assert np.std(left) < 2 * SIGMA < 0.2 * np.std(plain.field.residual(contacts, values))
    # The number stands for what the presses differ in, and places are found in spite of it.
    found = solve(family.field, values[300:], contacts[300:, None], np.full(122, SIGMA**-2))
    pulled = np.hypot(*contacts[300:, :2].T) * contacts[300:, 2] > 4.0  # elsewhere y does little
    assert np.corrcoef(found.nuisances[pulled, 0], y[300:][pulled])[0, 1] > 0.9
    assert np.abs(found.contacts[:, 0] - contacts[300:]).mean() < 0.02


def test_an_unknown_number_of_a_press_tells_nothing_of_its_sensor():
    rng = np.random.default_rng(9)
    parts, values = rng.normal(size=(5, 4, 30)), rng.normal(size=(5, 30))
    noise = 0.012**2
    normal, pull = 0.0, 0.0
    for part, value in zip(parts, values, strict=True):
        covariance = noise * np.eye(30) + np.outer(part[3], part[3])
        information = np.linalg.inv(covariance)
        normal = normal + part[1:3] @ information @ part[1:3].T
        pull = pull + part[1:3] @ information @ (value - part[0])
    for one, other in zip(evidence(parts, values, 2), (normal, pull), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
