"""The likelihood of contacts under a mixture, against closed forms and brute force."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from scipy import stats

from tactibench import Contacts
from tactibench.training import MixtureScale, count_nll, mixture_loss, mixture_values, pack_contacts

SCALE = MixtureScale(reach_mm=3.0, max_depth_mm=6.0)
DOUBLE = torch.float64


def random_case(seed, batch=2, anchors=5, contacts=3):
    generator = torch.Generator().manual_seed(seed)
    raw = 0.7 * torch.randn(batch, 7, anchors, generator=generator, dtype=DOUBLE)
    places = 6 * (torch.rand(anchors, 2, generator=generator, dtype=DOUBLE) - 0.5)
    truth = 4 * torch.rand(batch, contacts, 3, generator=generator, dtype=DOUBLE) - 1
    return raw, places, truth


def brute_force(raw, anchors, contacts, scale):
    """The formula, one number at a time, with the distributions of scipy."""
    total = 0.0
    for channels, found in zip(raw.numpy(), contacts.numpy(), strict=True):
        p = 1 / (1 + np.exp(-channels[0]))
        found = found[~np.isnan(found[:, 0])]
        variance = (p * (1 - p)).sum() + 1 / 12
        total -= stats.norm.logpdf(len(found), p.sum(), math.sqrt(variance))
        for contact in found:
            density = 0.0
            for m, (x, y) in enumerate(anchors.numpy()):
                mean = [
                    x + scale.reach_mm * math.tanh(channels[1, m]),
                    y + scale.reach_mm * math.tanh(channels[2, m]),
                    scale.max_depth_mm / 2 * (1 + channels[3, m]),
                ]
                std = np.hypot(np.exp(channels[4:7, m]), scale.floor_mm)
                density += p[m] / p.sum() * stats.norm.pdf(contact, mean, std).prod()
            total -= math.log(density)
    return total / len(raw)


@pytest.mark.parametrize("seed", range(5))
def test_the_loss_is_the_formula(seed):
    raw, anchors, contacts = random_case(seed)
    contacts[1, 1:] = torch.nan
    loss = mixture_loss(raw, anchors, contacts, SCALE)
    assert loss.item() == pytest.approx(brute_force(raw, anchors, contacts, SCALE), rel=1e-10)


def test_one_sure_anchor_has_the_likelihood_of_its_gaussian():
    mean, std = np.array([0.5, -0.2, 2.0]), np.array([0.3, 0.1, 0.2])
    raw = torch.tensor(
        [40.0, math.atanh(0.5 / 3), math.atanh(-0.2 / 3), 2 / 3 - 1, *np.log(std)], dtype=DOUBLE
    ).reshape(1, 7, 1)
    truth = np.array([0.6, -0.1, 2.3])
    loss = mixture_loss(
        raw, torch.zeros(1, 2), torch.tensor(truth).reshape(1, 1, 3), MixtureScale(3, 6, 1e-9)
    )
    place = -stats.norm.logpdf(truth, mean, std).sum()
    count = 0.5 * math.log(2 * math.pi / 12)  # the count is certain: only the half count is left
    assert loss.item() == pytest.approx(place + count, rel=1e-9)


def test_values_of_a_sure_anchor_are_what_the_channels_say():
    raw = torch.zeros(1, 7, 1)
    raw[0, 1] = 100.0
    raw[0, 3] = 1.0
    p, mean, std = mixture_values(raw, torch.tensor([[1.0, 2.0]]), SCALE)
    assert p.item() == 0.5
    assert mean.flatten().tolist() == [4.0, 2.0, 6.0]
    torch.testing.assert_close(std.flatten(), torch.ones(3), rtol=1e-5, atol=0)


def test_the_gradient_is_that_of_finite_differences():
    raw, anchors, contacts = random_case(1)
    contacts[0, 2] = torch.nan
    raw.requires_grad_()
    assert torch.autograd.gradcheck(lambda x: mixture_loss(x, anchors, contacts, SCALE), raw)


def test_neither_order_of_contacts_nor_of_anchors_matters():
    raw, anchors, contacts = random_case(2)
    loss = mixture_loss(raw, anchors, contacts, SCALE)
    for order in itertools.permutations(range(3)):
        other = mixture_loss(raw, anchors, contacts[:, list(order)], SCALE)
        torch.testing.assert_close(other, loss, rtol=1e-12, atol=0)
    turned = mixture_loss(raw.flip(-1), anchors.flip(0), contacts, SCALE)
    torch.testing.assert_close(turned, loss, rtol=1e-12, atol=0)


def test_anchors_may_differ_from_frame_to_frame():
    raw, anchors, contacts = random_case(3)
    each = torch.stack([anchors, anchors + 1])
    expected = [mixture_loss(raw[i : i + 1], each[i], contacts[i : i + 1], SCALE) for i in range(2)]
    torch.testing.assert_close(mixture_loss(raw, each, contacts, SCALE), sum(expected) / 2)


def test_padding_and_empty_frames_change_nothing_and_give_finite_gradients():
    raw, anchors, contacts = random_case(4)
    padded = torch.cat([contacts, torch.full((2, 2, 3), torch.nan, dtype=DOUBLE)], dim=1)
    assert mixture_loss(raw, anchors, padded, SCALE) == mixture_loss(raw, anchors, contacts, SCALE)
    empty = torch.full((2, 1, 3), torch.nan, dtype=DOUBLE)
    raw.requires_grad_()
    loss = mixture_loss(raw, anchors, empty, SCALE)
    expected = count_nll(raw[:, 0], torch.zeros(2)).mean()
    torch.testing.assert_close(loss, expected)
    loss.backward()
    assert raw.grad.isfinite().all()
    assert (raw.grad[:, 1:] == 0).all()


@pytest.mark.parametrize("extreme", [-1e4, 1e4])
@pytest.mark.parametrize("channel", range(7))
def test_extreme_outputs_give_a_finite_loss_and_gradient(channel, extreme):
    raw = torch.zeros(1, 7, 4)
    raw[:, channel] = extreme
    raw.requires_grad_()
    loss = mixture_loss(raw, torch.zeros(4, 2), torch.tensor([[[1.0, 2.0, 3.0]]]), SCALE)
    loss.backward()
    assert loss.isfinite()
    assert raw.grad.isfinite().all()


def poisson_binomial(p):
    """(M + 1,) probability of every count, from all 2^M outcomes."""
    total = np.zeros(len(p) + 1)
    for outcome in itertools.product([False, True], repeat=len(p)):
        total[sum(outcome)] += np.where(outcome, p, 1 - p).prod()
    return total


def test_the_count_term_has_the_moments_of_the_count():
    p = np.random.default_rng(6).uniform(0.02, 0.98, 10)
    exact = poisson_binomial(p)
    counts = np.arange(11)
    mean = exact @ counts
    variance = exact @ (counts - mean) ** 2
    logits = torch.logit(torch.tensor(p)).expand(11, 10)
    expected = -stats.norm.logpdf(counts, mean, math.sqrt(variance + 1 / 12))
    np.testing.assert_allclose(count_nll(logits, torch.tensor(counts)), expected, rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_count_term_is_close_to_the_probability_of_every_likely_count(seed):
    p = np.random.default_rng(seed).uniform(0.1, 0.9, 12)
    exact = poisson_binomial(p)
    logits = torch.logit(torch.tensor(p)).expand(13, 12)
    found = np.exp(-count_nll(logits, torch.arange(13)).numpy())
    assert np.abs(found - exact).max() < 0.02
    assert found.sum() == pytest.approx(1.0, abs=0.01)


def test_the_count_term_is_least_where_all_draws_are_certain_and_right():
    logits = torch.full((1, 16), -20.0)
    logits[0, 3] = 20.0
    right = count_nll(logits, torch.tensor([1])).item()
    assert right == pytest.approx(0.5 * math.log(2 * math.pi / 12), abs=1e-6)
    assert count_nll(logits, torch.tensor([0])).item() > right + 5
    assert count_nll(0 * logits, torch.tensor([1])).item() > right + 5


def test_pack_contacts_pads_with_nan():
    two = Contacts.truth([[1, 2], [3, 4]], [5, 6])
    packed = pack_contacts([Contacts.none(), two])
    assert packed.shape == (2, 2, 3)
    assert packed.dtype == torch.float32
    assert packed[0].isnan().all()
    assert packed[1].tolist() == [[1, 2, 5], [3, 4, 6]]
    assert pack_contacts([Contacts.none()]).shape == (1, 1, 3)
    assert pack_contacts([]).shape == (0, 1, 3)


@pytest.mark.parametrize("lengths", [(0, 6), (3, -1), (3, 6, 0)])
def test_a_scale_without_length_is_refused(lengths):
    with pytest.raises(ValueError, match="positive"):
        MixtureScale(*lengths)
