"""Random trials for the tests of metrics."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench.contacts import Contacts
from tactibench.metrics import Trials


def some_contacts(rng, count, spread=6.0):
    return Contacts(
        rng.uniform(-spread, spread, (count, 2)), rng.uniform(0.5, 6, count), rng.random(count)
    )


def near(rng, truth, *, noise=0.8, miss=0.2, extra=0.3):
    """A prediction of the true contacts: some are lost, some are made up, the order is random."""
    keep = rng.random(len(truth)) > miss
    xy = truth.xy[keep] + rng.normal(0, noise, (keep.sum(), 2))
    depth = truth.depth[keep] + rng.normal(0, 0.3, keep.sum())
    made_up = rng.binomial(2, extra / 2)
    xy = np.vstack([xy, rng.uniform(-6, 6, (made_up, 2))])
    depth = np.append(depth, rng.uniform(0.5, 6, made_up))
    return Contacts(xy, depth, rng.random(len(depth)))


def build(rng, groups, *, frames_per_press=2, gate=3.0, **options):
    """Trials with one true contact in groups 'all' and 'catch', three in 'triple', else two."""
    sizes = {"all": 1, "catch": 1, "triple": 3}
    truth = []
    for group in groups:
        contacts = some_contacts(rng, sizes.get(group, 2))
        truth.append(Contacts.truth(contacts.xy, contacts.depth))
    predictions = tuple(near(rng, t, **options) for t in truth)
    press = np.arange(len(groups)) // frames_per_press
    return Trials(tuple(truth), predictions, press, tuple(groups), gate=gate)


@pytest.fixture(scope="session")
def make_trials():
    return build


@pytest.fixture(scope="session")
def two_point(make_trials):
    """Two-point trials at three distances, with catch trials among them."""
    rng = np.random.default_rng(11)
    groups = [("6.5", "8.0", "12.0", "catch")[i % 4] for i in range(240)]
    return make_trials(rng, groups, frames_per_press=4, noise=0.5, miss=0.1, extra=0.2)


@pytest.fixture(scope="session")
def kinds(make_trials):
    """Dual and triple presses, three frames each."""
    rng = np.random.default_rng(12)
    groups = ["dual"] * 60 + ["triple"] * 90
    return make_trials(rng, groups, frames_per_press=3)


@pytest.fixture(scope="session")
def singles(make_trials):
    """Single presses, some of them without an answer."""
    return make_trials(np.random.default_rng(13), ["all"] * 200)
