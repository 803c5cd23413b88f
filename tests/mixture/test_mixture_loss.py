"""The likelihood of contacts under a mixture, and their reading, against plain loops."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tactibench.training import MixtureReader, MixtureScale, count_nll, mixture_loss

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


def anchors(*rows):
    """One frame of (p, x, y, depth) with std 0.1."""
    values = np.array(rows, dtype=float).reshape(1, -1, 4)
    return values[..., 0], values[..., 1:], np.full((*values.shape[:2], 3), 0.1)


def one_by_one(p, mean, std, threshold=0.5, merge=2.0):
    """The rule in plain loops: [(score, mean, std)] of one frame, best first."""
    left = [m for m in range(len(p)) if p[m] >= 0.01]
    found = []
    while left:
        first = max(left, key=lambda m: p[m])
        group = [m for m in left if np.linalg.norm(mean[m, :2] - mean[first, :2]) <= merge]
        left = [m for m in left if m not in group]
        total = p[group].sum()
        if total >= threshold:
            share = p[group] / total
            centre = share @ mean[group]
            second = share @ (std[group] ** 2 + mean[group] ** 2)
            found.append((min(total, 1.0), centre, np.sqrt(second - centre**2)))
    return sorted(found, key=lambda row: -row[0])


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 40))
@settings(max_examples=60, deadline=None)
def test_it_is_the_rule_written_as_loops(seed, frames, count):
    rng = np.random.default_rng(seed)
    p = rng.uniform(0, 1, (frames, count)) ** rng.integers(1, 6)
    mean, std = rng.uniform(-6, 6, (frames, count, 3)), rng.uniform(0.01, 1, (frames, count, 3))
    found = MixtureReader(max_count=100).read_all(p, mean, std)
    for i in range(frames):
        expected = one_by_one(p[i], mean[i], std[i])
        assert len(found[i]) == len(expected)
        for j in range(len(expected)):
            score, centre, spread = expected[j]
            assert found[i].score[j] == pytest.approx(score)
            if np.count_nonzero(found[i].score == found[i].score[j]) == 1:
                np.testing.assert_allclose([*found[i].xy[j], found[i].depth[j]], centre)
                np.testing.assert_allclose(found[i].std[j], spread, rtol=1e-6)


def test_at_most_max_count_contacts_are_returned():
    (found,) = MixtureReader().read_all(*anchors(*((0.9 - k / 100, 5 * k, 0, 1) for k in range(9))))
    assert len(found) == 6
    assert found.score[0] == 0.9


@pytest.mark.parametrize("shape", [(0, 4), (3, 0), (3, 4)])
def test_nothing_present_gives_no_contacts(shape):
    found = MixtureReader().read_all(np.zeros(shape), np.zeros((*shape, 3)), np.ones((*shape, 3)))
    assert [len(contacts) for contacts in found] == [0] * shape[0]


def test_values_that_are_not_finite_are_refused():
    p, mean, std = anchors((0.9, 1, 2, np.nan))
    with pytest.raises(ValueError, match="not finite"):
        MixtureReader().read_all(p, mean, std)
