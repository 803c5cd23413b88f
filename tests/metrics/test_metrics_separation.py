"""Two-point trials against plain loops and closed forms."""

import math

import numpy as np
import pytest

from tactibench import UserError
from tactibench.contacts import Contacts
from tactibench.metrics import Trials
from tactibench.metrics.registry import score

NAMES = ["distance_mae_mm", "distance_penalised_mm", "resolved", "orientation_mae_deg"]


def plain(trials, group):
    out = {name: [] for name in NAMES}
    for t, p, g in zip(trials.truth, trials.predictions, trials.group, strict=True):
        if g == "catch" or (group != "all" and g != group):
            continue
        true = math.dist(t.xy[0], t.xy[1])
        straight = crossed = None
        if len(p) == 2:
            d = [[math.dist(a, b) for b in p.xy] for a in t.xy]
            straight = max(d[0][0], d[1][1]) < trials.gate
            crossed = max(d[0][1], d[1][0]) < trials.gate
            # two pairs inside the gate always cost less than one pair and a whole gate here
            one = min(min(row) for row in d)
            two = min(
                [d[0][0] + d[1][1]] * straight + [d[0][1] + d[1][0]] * crossed, default=math.inf
            )
            assert two < one + trials.gate or not (straight or crossed)
        solved = bool(straight or crossed)
        out["resolved"].append(solved)
        out["distance_penalised_mm"].append(true)
        if solved:
            error = abs(math.dist(p.xy[0], p.xy[1]) - true)
            out["distance_mae_mm"].append(error)
            out["distance_penalised_mm"][-1] = error
            axis = [math.degrees(math.atan2(*(c.xy[1] - c.xy[0])[::-1])) for c in (t, p)]
            turn = (axis[1] - axis[0]) % 180
            out["orientation_mae_deg"].append(min(turn, 180 - turn))
    return out


def test_against_plain_loops(two_point):
    rows = score(NAMES, two_point, rng=np.random.default_rng(0))
    assert [r.group for r in rows[:4]] == ["6.5", "8.0", "12.0", "all"]
    for row in rows:
        expected = plain(two_point, row.group)[row.metric]
        assert row.n == len(expected)
        assert row.value == pytest.approx(np.mean(expected))


def pair(distance, angle, centre=(0.0, 0.0)):
    half = distance / 2 * np.array([math.cos(angle), math.sin(angle)])
    return np.array([centre + half, centre - half])


def test_a_pair_of_equal_predictions_has_a_guessed_axis():
    truth = Contacts.truth(pair(4, 0.3), [1, 1])
    guess = Contacts(np.zeros((2, 2)), [1, 1], [1, 1])
    trials = Trials((truth,), (guess,), [0], ("4.0",))
    (row, _) = score(["orientation_mae_deg"], trials, rng=np.random.default_rng(0))
    assert row.value == 45


def test_other_numbers_of_true_contacts_are_refused(kinds):
    with pytest.raises(UserError, match="'triple' has 3"):
        score(["resolved"], kinds, rng=np.random.default_rng(0))
