"""How many contacts, and where, on a known field of 81 pins; and what fields that add up leave."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactibench.superposition import Field
from tactibench_superpose import FEWEST, Detector, ModelError

SIGMA = 0.02  # px
PITCH = 1.8 * 4  # px
AXIS = np.arange(-7.2, 7.3, 1.8)
PINS = np.stack(np.meshgrid(AXIS, AXIS), axis=-1).reshape(-1, 2)  # mm
SURE = np.ones(len(PINS), dtype=bool)
IMAGE = np.zeros((8, 8), dtype=np.uint8)


def nothing_found(images, moved):
    """Pins without a profile cannot be followed again."""
    return moved, np.zeros((len(images), len(PINS)), dtype=bool)


def push(contacts):
    """(N, 162) px: pins flee from contacts (N, 3) mm, deeper is more."""
    away = PINS - contacts[:, None, :2]
    depth = contacts[:, 2:]
    way = (0.3 * depth + 0.02 * depth**2) * np.exp(-(away**2).sum(axis=-1) / (2 * 2.2**2))
    return np.concatenate([way * away[..., 0], way * away[..., 1]], axis=1)


@pytest.fixture(scope="module")
def field():
    contacts = np.random.default_rng(0).uniform([-6, -6, 0.5], [6, 6, 6], (500, 3))
    return Field.learn(contacts, push(contacts))


def detector(field, gain=1.3, most=6, sigma=SIGMA):
    pins = SimpleNamespace(rest=PINS * 4 + 40, pitch=PITCH, retrack=nothing_found)
    pins.moved = lambda motion: pins
    weight = np.full(field.coefficients.shape[-1], 1 / sigma**2)
    return Detector.of(field, pins, weight, gain, most)


def find(search, moved, sure):
    """The solution, and the share of every contact."""
    found = search.find(IMAGE, moved, sure)
    return found.solution, found.share


@pytest.fixture(scope="module")
def usual(field):
    return detector(field)


def noise(seed):
    return SIGMA * np.random.default_rng(seed).normal(size=2 * len(PINS))


def far_apart(count):
    places = [[-4.5, -4.0, 2.0], [4.5, -4.0, 3.0], [-4.0, 4.5, 4.0], [4.0, 4.0, 1.5]]
    return np.array(places)[:count]


def in_order(found, wanted):
    """The contacts found, as the wanted ones stand."""
    apart = np.linalg.norm(found[:, None, :2] - wanted[None, :, :2], axis=-1)
    order = apart.argmin(axis=0)
    assert sorted(order) == list(range(len(wanted)))
    return found[order]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("share", [0.1, 0.9])
def test_doubtful_pins_do_not_hide_a_contact(usual, field, seed, share):
    rng = np.random.default_rng(seed)
    wanted = np.array([[*rng.uniform(-5, 5, 2), rng.uniform(0.5, 5)]])
    sure = rng.uniform(size=len(PINS)) >= share
    solution, _ = find(usual, field(wanted)[0] + noise(seed), sure)
    np.testing.assert_allclose(solution.contacts[0], wanted, atol=0.1)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", [0, 1])
def test_as_many_are_found_as_there_are(usual, field, count, seed):
    wanted = far_apart(count) + np.random.default_rng(seed).uniform(-0.8, 0.8, (count, 3))
    solution, taken = find(usual, field(wanted).sum(axis=0) + noise(seed), SURE)
    assert len(taken) == count == solution.contacts.shape[1]
    np.testing.assert_allclose(in_order(solution.contacts[0], wanted), wanted, atol=0.1)
    assert ((taken > 0) & (taken <= 1)).all()


@pytest.mark.parametrize("distance", [5.5, 8.0])
@pytest.mark.parametrize("angle", [0.2, 1.3])
def test_two_near_ones_are_not_taken_for_one(usual, field, distance, angle):
    half = distance / 2 * np.array([np.cos(angle), np.sin(angle)])
    wanted = np.array([[*(0.5 - half), 2.0], [*(0.5 + half), 3.0]])
    solution, taken = find(usual, field(wanted).sum(axis=0) + noise(9), SURE)
    assert len(taken) == 2
    np.testing.assert_allclose(in_order(solution.contacts[0], wanted), wanted, atol=0.1)


def test_noise_and_nothing_are_no_contact(usual):
    for moved in (np.zeros(2 * len(PINS)), *(noise(seed) for seed in range(20))):
        solution, taken = find(usual, moved, SURE)
        assert len(taken) == 0
        assert solution.contacts.shape == (1, 0, 3)
        np.testing.assert_array_equal(solution.left[0], moved)


def test_a_higher_gain_asks_more_of_a_further_contact(field):
    """A weak second contact beside a strong one."""
    strong, weak = np.array([-4.0, -4.0, 5.0]), np.array([4.5, 4.5, 0.5])
    moved = field(strong) + field(weak) + noise(5)
    counts = [len(find(detector(field, gain), moved, SURE)[1]) for gain in (1.05, 1.3, 100.0)]
    assert counts[:2] == [2, 2]
    assert counts[2] == 1


def test_doubtful_pins_are_named_by_the_contacts_that_were_found(usual, field):
    """Two neighbours taken for each other: told to be doubtful, they do no harm."""
    wanted = far_apart(2)
    moved = field(wanted).sum(axis=0) + noise(7)
    places = PINS * 4 + 40 + moved.reshape(2, -1).T
    pair = [20, 21]
    places[pair] = places[pair[::-1]]
    mistaken = (places - (PINS * 4 + 40)).T.reshape(-1)
    doubtful = SURE.copy()
    doubtful[pair] = False
    clean, _ = find(usual, moved, SURE)
    solution, taken = find(usual, mistaken, doubtful)
    assert len(taken) == 2
    # Both pins count again, each at its own place.
    np.testing.assert_allclose(solution.contacts, clean.contacts, atol=2e-3)
    np.testing.assert_allclose(solution.left, clean.left, atol=1e-2)
    np.testing.assert_allclose(solution.normal, clean.normal, rtol=1e-2, atol=1)


@pytest.mark.parametrize("seed", range(3))
def test_pins_that_went_anywhere_are_no_contact(usual, seed):
    """As in a frame of another sensor: none is sure, and nothing explains where they are."""
    moved = np.random.default_rng(seed).uniform(-PITCH / 2, PITCH / 2, 2 * len(PINS))
    _, taken = find(usual, moved, ~SURE)
    assert len(taken) == 0


def interplay(contacts, rng):
    """(162,) px that two contacts leave beyond their sum, like a faint third one between them."""
    (x, y, depth), (u, v, other) = contacts[:2]
    between = np.array([[(x + u) / 2, (y + v) / 2, 0.5 * min(depth, other)]])
    return push(between)[0] * rng.uniform(0.6, 1.4)


def pair(rng):
    x, y = rng.uniform(-0.5, 0.5, 2)
    return np.array([[x - 4.6, y, rng.uniform(2, 4)], [x + 4.6, y, rng.uniform(2, 4)]])


@pytest.fixture(scope="module")
def learned_from_pairs(field):
    rng = np.random.default_rng(3)
    left = []
    for _ in range(400):
        contacts = pair(rng)
        left.append(interplay(contacts, rng) + SIGMA * rng.normal(size=2 * len(PINS)))
    plain = detector(field)
    return replace(plain, model_error=ModelError.learn(np.array(left), plain.weight))


@pytest.mark.parametrize("seed", range(4))
def test_what_two_contacts_usually_leave_is_no_third_one(usual, learned_from_pairs, field, seed):
    rng = np.random.default_rng(100 + seed)
    contacts = pair(rng)
    moved = field(contacts).sum(axis=0) + interplay(contacts, rng) + noise(seed)
    assert len(find(usual, moved, SURE)[1]) > 2
    solution, taken = find(learned_from_pairs, moved, SURE)
    assert len(taken) == 2
    apart = np.linalg.norm(
        in_order(solution.contacts[0], contacts)[:, :2] - contacts[:, :2], axis=1
    )
    assert apart.max() < 1.0


@pytest.mark.parametrize("seed", range(4))
def test_a_third_contact_elsewhere_is_still_found(learned_from_pairs, field, seed):
    rng = np.random.default_rng(200 + seed)
    contacts = np.array([*pair(rng), [0.0, 5.5, 3.0]])
    moved = field(contacts).sum(axis=0) + interplay(contacts, rng) + noise(seed)
    solution, taken = find(learned_from_pairs, moved, SURE)
    assert len(taken) >= 3
    apart = np.linalg.norm(solution.contacts[0][:, :2] - contacts[2, :2], axis=1)
    assert apart.min() < 0.8


COUNT = 12
WEIGHT = np.random.default_rng(0).uniform(1e4, 1e5, 2 * COUNT)


def drawn(count, seed=1):
    """(count, 24) px: three usual patterns, and noise of the weight's deviation."""
    rng = np.random.default_rng(seed)
    patterns = np.random.default_rng(2).normal(size=(3, 2 * COUNT))
    noise = rng.normal(size=(count, 2 * COUNT)) / np.sqrt(WEIGHT)
    return 0.1 * rng.normal(size=(count, 3)) @ patterns + noise


@pytest.fixture(scope="module")
def learned():
    return ModelError.learn(drawn(4000), WEIGHT)


@pytest.mark.parametrize("lost", [(), (0,), (1, 5, 11)], ids=str)
def test_the_whitener_makes_unseen_presses_independent(learned, lost):
    sure = np.ones(COUNT, dtype=bool)
    sure[list(lost)] = False
    whitener = learned.whitener(sure)
    assert whitener.shape == (2 * COUNT, 2 * (COUNT - len(lost)))
    made = drawn(4000, seed=3) @ whitener
    np.testing.assert_allclose(made.T @ made / len(made), np.eye(made.shape[1]), atol=0.15)


def test_nothing_is_known_better_than_the_noise_lets_it():
    quiet = ModelError.learn(1e-9 * drawn(FEWEST), WEIGHT)
    np.testing.assert_allclose(quiet.covariance, np.eye(2 * COUNT), atol=1e-9)
