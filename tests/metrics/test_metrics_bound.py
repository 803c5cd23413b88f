"""Error over bound: on every axis, and not spoilt by a contact without a bound."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactibench.contacts import Contacts
from tactibench.metrics import Trials
from tactibench.metrics.registry import score


def trials(bound: Any) -> Trials:
    """Errors drawn from the bound where there is one, of 1 mm elsewhere."""
    rng = np.random.default_rng(5)
    spread = np.where(np.isinf(bound), 1.0, bound)
    truth = np.tile([1.0, 2.0, 3.0], (len(bound), 1))
    guess = truth + rng.normal(size=bound.shape) * spread
    as_contact = lambda p: Contacts(p[None, :2], p[2:], [1.0])  # noqa: E731
    n = len(bound)
    return Trials(
        tuple(map(as_contact, truth)),
        tuple(map(as_contact, guess)),
        np.arange(n),
        ("all",) * n,
        bound=tuple(row[None] for row in bound),
    )


def ratios(bound: Any) -> dict[str, Any]:
    rows = score(["rmse_over_bound"], trials(bound), rng=np.random.default_rng(0))
    return {row.group: row for row in rows}


def test_a_contact_without_a_bound_is_left_out_of_both_sums() -> None:
    bound = np.full((4000, 3), 0.01)
    whole = ratios(bound)
    bound[:100] = np.inf
    bound[100:150, 1] = np.inf
    some = ratios(bound)
    for axis, n in zip("xyz", (3900, 3850, 3900), strict=True):
        assert whole[axis].n == 4000
        assert some[axis].n == n
        assert some[axis].value == pytest.approx(1.0, abs=0.05)
        assert some[axis].low < 1.0 < some[axis].high


def test_without_any_bound_there_is_no_ratio() -> None:
    for row in ratios(np.full((5, 3), np.inf)).values():
        assert (row.value, row.n) == (None, 0)


@pytest.mark.parametrize("wrong", [np.nan, 0.0])
def test_other_values_are_refused(wrong: float) -> None:
    bound = np.full((3, 3), 0.01)
    bound[1, 2] = wrong
    with pytest.raises(ValueError, match=r"not finite|positive"):
        trials(bound)


def test_pairs_are_compared_contact_by_contact_inside_the_gate() -> None:
    """Errors of a quarter of the bound on x, once and twice it on y and depth; one is missed."""
    rng = np.random.default_rng(6)
    n, scale = 2000, np.array([0.25, 1.0, 2.0])
    bound = rng.uniform(0.01, 0.05, (n, 2, 3))
    places = np.array([[-4.0, 0.0, 2.0], [4.0, 0.0, 3.0]])
    guess = places + rng.normal(size=bound.shape) * bound * scale

    def contacts(rows: Any) -> Contacts:
        return Contacts(rows[:, :2], rows[:, 2], np.ones(len(rows)))

    guesses = [contacts(rows[::-1]) for rows in guess]  # in another order than the truth
    guesses[0] = contacts(guess[0][1:])
    made = Trials(
        (contacts(places),) * n, tuple(guesses), np.arange(n), ("8.0",) * n, bound=tuple(bound)
    )
    found = {r.group: r for r in score(["rmse_over_bound"], made, rng=np.random.default_rng(0))}
    for axis, expected in zip("xyz", scale, strict=True):
        assert found[axis].value == pytest.approx(expected, rel=0.05)
        assert found[axis].n == 2 * n - 1
    error = np.concatenate([guess[0, 1:] - places[1:], *(guess[1:] - places)])
    spread = np.concatenate([bound[0, 1:], *bound[1:]])
    by_hand = np.sqrt((error**2).sum(axis=0) / (spread**2).sum(axis=0))
    assert [found[axis].value for axis in "xyz"] == pytest.approx(list(by_hand))
