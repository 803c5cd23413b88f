"""What contacts do to each other: symmetries, laws found again, and the one that ships."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from tactibench.superposition import (
    NeighbourLaw,
    Residual,
    drag_clue,
    nominal_inverse_law,
    nominal_law,
    recombined,
)


def apart(frames, count, rng, closest=5.5, depths=(0.5, 6.0)):
    """(frames, count, 3) mm over the workspace, no two contacts closer."""
    found = []
    while len(found) < frames:
        xy = rng.uniform(-6.4, 6.4, (count, 2))
        gaps = np.linalg.norm(xy[:, None] - xy[None], axis=-1)[np.triu_indices(count, 1)]
        if (gaps >= closest).all():
            found.append(np.column_stack([xy, rng.uniform(*depths, count)]))
    return np.array(found).reshape(frames, count, 3)


def pairs(distance, depths, rng):
    """(S, 2, 3) of equally deep tips at a distance (S,), turned and shifted at random."""
    angle = rng.uniform(0, 2 * np.pi, len(distance))
    half = np.stack([np.cos(angle), np.sin(angle)], axis=1) * distance[:, None] / 2
    xy = rng.uniform(-1, 1, (len(distance), 1, 2)) + np.stack([-half, half], axis=1)
    return np.concatenate([xy, np.repeat(depths[:, None, None], 2, axis=1)], axis=2)


def turned(contacts, angle):
    c, s = np.cos(angle), np.sin(angle)
    return contacts @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def random_law(rng, size=0.05):
    pair = rng.normal(size=NeighbourLaw.none().pair.shape) * size / 10
    crowd = rng.normal(size=NeighbourLaw.none().crowd.shape) * size
    return NeighbourLaw(pair, crowd)


SLIDES, STICKS = -0.29, 0.31
"""How far the skin follows tips without friction, and at a coefficient of 0.5 (``drag_clue``)."""
LAWS = {
    "without friction": lambda: nominal_law(SLIDES),
    "shipped": lambda: nominal_law(STICKS),
    "inverse": lambda: nominal_inverse_law(STICKS),
    "random": lambda: random_law(np.random.default_rng(0)),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("shape", [(4, 1, 3), (4, 0, 3), (0, 2, 3)])
def test_a_contact_alone_is_itself(law, shape):
    contacts = np.random.default_rng(1).uniform(1, 5, shape)
    np.testing.assert_array_equal(LAWS[law]().shift(contacts), np.zeros(shape))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("angle", [0.3, 3.0])
def test_a_turned_press_is_shifted_alike(law, count, angle):
    contacts = apart(50, count, np.random.default_rng(count), closest=3.0)
    law = LAWS[law]()
    np.testing.assert_allclose(
        law.shift(turned(contacts, angle)), turned(law.shift(contacts), angle), atol=1e-8
    )


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("count", [2, 3])
def test_contacts_have_no_order(law, count):
    contacts = apart(6, count, np.random.default_rng(2))
    law = LAWS[law]()
    shift = law.shift(contacts)
    for order in permutations(range(count)):
        np.testing.assert_allclose(law.shift(contacts[:, order]), shift[:, order], atol=1e-12)


def test_constant_coefficients_are_towards_beside_and_depth():
    """The formula by hand: the constant term alone."""
    law = NeighbourLaw.none()
    law.pair[0] = [0.3, 0.1, -0.2]
    shift = law.shift(np.array([[[-4.0, 1.0, 2.0], [4.0, 1.0, 3.0]]]))[0]
    np.testing.assert_allclose(shift, [[0.3, 0.1, -0.2], [-0.3, -0.1, -0.2]], atol=1e-12)
    # Three contacts: every neighbour has its say.
    three = np.array([[[0.0, 0.0, 2.0], [6.0, 0.0, 2.0], [0.0, 6.0, 2.0]]])
    shift = law.shift(three)[0, 0]
    np.testing.assert_allclose(shift, [0.3 - 0.1, 0.1 + 0.3, -0.4], atol=1e-12)


def test_a_law_of_pairs_is_found_again():
    rng = np.random.default_rng(7)
    law, contacts = random_law(rng), apart(900, 2, rng)
    found = NeighbourLaw.learn([contacts], [law.shift(contacts)], NeighbourLaw.none())
    others = apart(200, 2, rng)
    wanted = law.shift(others)
    assert np.abs(wanted).mean() > 0.03
    assert np.abs(found.shift(others) - wanted).mean() < 0.002
    # Nothing was said of crowds.
    np.testing.assert_allclose(found.crowd, 0, atol=1e-9)


@pytest.mark.long
def test_a_law_of_pairs_and_crowds_is_found_again():
    rng = np.random.default_rng(8)
    law = random_law(rng)
    sets = [apart(900, 2, rng), apart(400, 3, rng)]
    shifts = [law.shift(one) for one in sets]
    first = NeighbourLaw.learn(sets[:1], shifts[:1], NeighbourLaw.none())
    found = NeighbourLaw.learn(sets, shifts, first)
    others = apart(200, 3, rng)
    wanted, only_pairs = law.shift(others), NeighbourLaw(law.pair, 0 * law.crowd).shift(others)
    error = np.abs(found.shift(others) - wanted).mean()
    assert error < 0.005
    assert error < 0.25 * np.abs(only_pairs - wanted).mean(), "the crowd has a part"


@pytest.mark.parametrize("clue", [SLIDES, 0.15, STICKS])
@pytest.mark.parametrize("count", [2, 3])
def test_forward_and_back_is_the_same_contact(count, clue):
    rng = np.random.default_rng(15)
    if count == 2:
        contacts = pairs(rng.uniform(6.5, 12.0, 500), rng.uniform(0.8, 5.0, 500), rng)
    else:
        contacts = apart(300, 3, rng, closest=7.0, depths=(1.0, 4.0))
    equivalents = nominal_law(clue).equivalents(contacts)
    back = nominal_inverse_law(clue).equivalents(equivalents) - contacts
    assert np.abs(back).mean() < 0.03
    assert np.quantile(np.abs(back), 0.95) < 0.1
    # A small part of the way there.
    assert np.abs(back).mean() < 0.15 * np.abs(equivalents - contacts).mean()


def test_contacts_put_together_anew_are_the_old_ones_far_enough_apart():
    for count in (2, 3):
        contacts = apart(50, count, np.random.default_rng(12))
        anew = recombined(contacts)
        assert len(anew) > 25
        old = {tuple(one) for one in contacts.reshape(-1, 3)}
        assert {tuple(one) for one in anew.reshape(-1, 3)} <= old
        gaps = np.linalg.norm(anew[:, :, None, :2] - anew[:, None, :, :2], axis=-1)
        assert (gaps[:, *np.triu_indices(count, 1)] >= 5.5).all()
        assert len(recombined(contacts[:0])) == 0


def test_level_pairs_say_nothing_of_uneven_ones():
    rng = np.random.default_rng(13)
    law, level = (
        nominal_law(SLIDES),
        pairs(rng.uniform(6.5, 12, 500), rng.uniform(0.5, 6, 500), rng),
    )
    more = 0.05 * np.sin(2 * level[..., 2:]) * np.array([0.0, 0.0, 1.0])
    shifts = law.shift(level) + more + 0.01 * rng.normal(size=level.shape)
    uneven = pairs(rng.uniform(6.5, 12, 200), rng.uniform(1, 3, 200), rng)
    uneven[:, 0, 2] += 2.5
    free, held = (NeighbourLaw.learn([level], [shifts], law, weight) for weight in (0.0, 1.0))
    astray = [np.abs(one.shift(uneven) - law.shift(uneven)).mean() for one in (free, held)]
    assert astray[1] < 0.5 * astray[0]
    off = [np.abs(one.shift(level) - law.shift(level) - more).mean() for one in (free, held)]
    assert off[1] < off[0] + 0.01


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


def test_friction_is_read_from_single_presses(push_pins):
    """Skin that follows tips moves all pins away from the axis."""

    class Pulled:
        """A field whose pins move by ``pull`` along the way to the contact, beyond their own."""

        def __init__(self, pull):
            self.pull = pull

        def __call__(self, contacts):
            own = push_pins(contacts[:, None])
            away = contacts[:, :2] / np.hypot(*contacts[:, :2].T)[:, None]
            return own + self.pull * np.repeat(away, own.shape[1] // 2, axis=1)

    clues = [drag_clue(Pulled(pull), 61) for pull in (-0.5, 0.0, 0.5, 50.0)]
    assert clues == sorted(clues)
    assert clues[-1] == pytest.approx(1.0, abs=0.02)  # all pins move alike
    laws = [nominal_law(clue).pair for clue in (-9.0, SLIDES - 0.01, 0.0, 2.0, 9.0)]
    np.testing.assert_array_equal(laws[0], laws[1])  # no friction is the least
    np.testing.assert_array_equal(laws[3], laws[4])
    assert not np.allclose(laws[1], laws[2])
