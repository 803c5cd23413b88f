import numpy as np
import pytest

from tactibench import Contacts, PlatePose
from tactibench.training import scale_std, split_calibration, std_factors


def drawn(count, std, stated, seed=0, contacts=1):
    """Truth at 5 mm from each other, and answers off by a Gaussian of ``std``."""
    rng = np.random.default_rng(seed)
    truth, found = [], []
    for _ in range(count):
        true = np.column_stack([5.0 * np.arange(contacts), np.zeros(contacts), np.ones(contacts)])
        off = true + rng.normal(size=true.shape) * std
        truth.append(Contacts.truth(true[:, :2], true[:, 2]))
        std_ = np.tile(stated, (contacts, 1))
        found.append(Contacts(off[:, :2], off[:, 2], np.ones(contacts), std_))
    return found, truth


def coverage(found, truth):
    error = np.concatenate([f.xy - t.xy for f, t in zip(found, truth, strict=True)])
    std = np.concatenate([f.std[:, :2] for f in found])
    return float((((error / std) ** 2).sum(axis=1) < -2 * np.log(0.05)).mean())


def test_std_that_are_too_small_become_the_true_ones():
    found, truth = drawn(4000, [0.02, 0.05, 0.1], [0.01, 0.05, 0.2])
    factors = std_factors(found, truth)
    np.testing.assert_allclose(factors[0], [2, 1, 0.5], rtol=0.06)
    assert np.array_equal(factors[0], factors[1])
    scaled = [scale_std(contacts, factors) for contacts in found]
    assert coverage(scaled, truth) == pytest.approx(0.95, abs=2e-3)


def test_contacts_beside_others_have_factors_of_their_own():
    alone, alone_truth = drawn(500, [0.02] * 3, [0.02] * 3)
    beside, beside_truth = drawn(500, [0.06] * 3, [0.02] * 3, seed=1, contacts=2)
    factors = std_factors([*alone, *beside], [*alone_truth, *beside_truth])
    np.testing.assert_allclose(factors, [[1] * 3, [3] * 3], rtol=0.1)
    assert np.array_equal(scale_std(beside[0], factors).std, beside[0].std * factors[1])


def test_too_few_contacts_leave_the_std_as_stated():
    assert np.array_equal(std_factors(*drawn(19, [1] * 3, [0.1] * 3)), np.ones((2, 3)))
    assert np.array_equal(std_factors([], []), np.ones((2, 3)))


def test_frames_with_another_number_of_contacts_do_not_count():
    _, truth = drawn(40, [1] * 3, [0.1] * 3)
    assert np.array_equal(std_factors([Contacts.none()] * 40, truth), np.ones((2, 3)))
    found, truth = drawn(500, [0.02] * 3, [0.02] * 3)
    wrong = [*drawn(50, [1] * 3, [0.02] * 3, contacts=2)[0], *[Contacts.none()] * 50]
    more = std_factors([*found, *wrong], [*truth, *truth[:100]])
    assert np.array_equal(more, std_factors(found, truth))


def test_the_order_of_the_answers_does_not_matter():
    found, truth = drawn(500, [0.02] * 3, [0.02] * 3, contacts=2)
    turned = [Contacts(f.xy[::-1], f.depth[::-1], f.score, f.std[::-1]) for f in found]
    np.testing.assert_allclose(std_factors(turned, truth), std_factors(found, truth))


def test_95_percent_lie_inside_whatever_the_distribution():
    rng, std = np.random.default_rng(2), np.array([0.1, 0.2, 0.05])
    truth = [Contacts.truth([[0, 0]], [1])] * 500
    errors = rng.standard_t(2, (500, 3))
    found = [Contacts([e[:2]], [1 + e[2]], [1], [std]) for e in errors]
    factors = std_factors(found, truth)
    scaled = [scale_std(contacts, factors) for contacts in found]
    assert coverage(scaled, truth) == pytest.approx(0.95, abs=2e-3)
    assert np.mean(np.abs(errors[:, 2] / (std * factors[0])[2]) <= 1.96) == pytest.approx(
        0.95, abs=3e-3
    )


def test_contacts_without_std_stay_without():
    plain = Contacts.truth([[0, 0]], [1])
    assert scale_std(plain, np.ones((2, 3))).std is None
    assert np.array_equal(std_factors([plain] * 30, [plain] * 30), np.ones((2, 3)))


def test_every_twentieth_frame_with_several_contacts_is_for_calibration():
    one, two = Contacts.truth([[0, 0]], [1]), Contacts.truth([[0, 0], [5, 0]], [1, 1])
    used, kept = split_calibration([one, two] * 45)
    assert kept.tolist() == [39, 79]
    assert sorted([*used, *kept]) == list(range(90))
    assert split_calibration([one] * 100)[1].size == 0
    assert split_calibration([PlatePose(1, 2)] * 100)[1].size == 0
    assert split_calibration([])[0].size == 0
