"""Metrics of hard cases against ten-line implementations and closed forms."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import Contacts, UserError
from tactibench.metrics import NOT_FINITE, RAISED, Trials, ospa
from tactibench.metrics.registry import score
from tactibench.protocols import Axis
from tactibench.records import Metric

AXIS = Axis("shift", "camera", "px", "rising", 0.0, (1.0, 2.0), "plain:0")
EMPTY = Axis("empty", "nothing", "", "unordered", None, (0.0,), "")
NAMES = (
    "ospa_mm",
    "error_ratio",
    "worst_ratio",
    "doubles_at",
    "position_mean_mm",
    "missed",
    "false_per_1000",
    "not_finite",
    "raised",
)


def contacts(*points: tuple[float, float, float]) -> Contacts:
    table = np.array(points).reshape(-1, 3)
    return Contacts.truth(table[:, :2], table[:, 2])


def off(error: float) -> Contacts:
    """One contact, depth off by so much."""
    return contacts((0, 0, 2 + error))


def trials(errors: dict[str, list[float]], **more: object) -> Trials:
    """One contact a frame, of press k, off by so much; group -> errors."""
    rows = [(g, k, e) for g, found in errors.items() for k, e in enumerate(found)]
    return Trials(
        tuple(contacts((0, 0, 2)) for _ in rows),
        tuple(off(e) for _, _, e in rows),
        np.array([k for _, k, _ in rows]),
        tuple(g for g, _, _ in rows),
        axes=(AXIS,),
        **more,  # type: ignore[arg-type]
    )


def rows(made: Trials, *names: str) -> dict[tuple[str, str], Metric]:
    found = score(names or NAMES, made, rng=np.random.default_rng(0))
    return {(row.metric, row.group): row for row in found}


@given(st.integers(0, 3), st.integers(0, 3), st.integers(0, 2**32))
def test_ospa_against_all_assignments(n: int, m: int, seed: int) -> None:
    rng, gate = np.random.default_rng(seed), 3.0
    true, found = (
        np.column_stack([rng.uniform(-4, 4, (k, 2)), rng.uniform(1, 5, k)]) for k in (n, m)
    )
    made = Trials((contacts(*true),), (contacts(*found),), np.zeros(1), ("all",), gate=gate)
    few, many = (true, found) if n <= m else (found, true)

    def flat(p: tuple[int, ...]) -> float:
        return sum(min(np.hypot(*(few[i, :2] - many[j, :2])), gate) for i, j in enumerate(p))

    best = min(itertools.permutations(range(len(many)), len(few)), key=flat)
    pairs = [
        (few[i], many[j])
        for i, j in enumerate(best)
        if np.hypot(*(few[i, :2] - many[j, :2])) < gate
    ]
    total = sum(min(float(np.linalg.norm(a - b)), gate) for a, b in pairs)
    expected = (total + gate * (len(many) - len(pairs))) / max(len(many), 1)
    assert ospa(made).values[0] == pytest.approx(expected)


def test_ospa_needs_a_gate() -> None:
    with pytest.raises(UserError, match="'ospa_mm' needs a finite gate"):
        ospa(trials({"plain:0": [0.1]}, gate=np.inf))


def test_ratio_and_doubling_of_known_errors() -> None:
    found = rows(trials({"plain:0": [0.1] * 9, "shift:1": [0.15] * 9, "shift:2": [0.25] * 9}))
    assert found["ospa_mm", "shift:1"].value == pytest.approx(0.15)
    assert found["error_ratio", "shift:1"].value == pytest.approx(1.5)
    assert found["error_ratio", "shift:2"].value == pytest.approx(2.5)
    assert found["worst_ratio", "all"].value == pytest.approx(2.5)
    assert found["doubles_at", "shift"].value == pytest.approx(1.5)
    assert found["doubles_at", "shift"].clusters == 9
    assert ("error_ratio", "plain:0") not in found


def test_an_error_that_does_not_double_is_censored_and_one_without_cases_is_none() -> None:
    found = rows(trials({"plain:0": [0.1] * 9, "shift:1": [0.15] * 9, "shift:2": [0.19] * 9}))
    row = found["doubles_at", "shift"]
    assert (row.value, row.censored) == (2.0, ">")
    hopeless = rows(trials({"plain:0": [1.6] * 9, "shift:1": [1.7] * 9, "shift:2": [1.7] * 9}))
    assert hopeless["doubles_at", "shift"].value is None  # 3.2 mm is more than the gate
    assert hopeless["error_ratio", "shift:1"].value == pytest.approx(1.7 / 1.6)
    some = rows(trials({"plain:0": [0.1] * 9, "shift:2": [0.5] * 9}))  # --quick leaves cases out
    assert some["doubles_at", "shift"].value is None
    assert some["error_ratio", "shift:1"].value is None
    without = rows(trials({"shift:2": [0.5] * 9}))
    assert without["worst_ratio", "all"].value is None


def test_false_contacts_under_faults_stand_apart() -> None:
    nothing, one = contacts(), contacts((0, 0, 2))
    groups = ("empty:0",) * 100 + ("untouched:dim",) * 50 + ("untouched:shift",) * 50
    made = Trials(
        (nothing,) * 200 + (one,),
        (nothing,) * 99 + (one,) * 3 + (nothing,) * 98 + (one,),
        np.append(np.tile(np.arange(100), 2), 200),
        (*groups, "plain:0"),
        axes=(EMPTY,),
    )
    found = rows(made)
    rates = {g: row.value for (name, g), row in found.items() if name == "false_per_1000"}
    assert rates == {
        "all": 10.0,
        "untouched": 20.0,
        "untouched:dim": 40.0,
        "untouched:shift": 0.0,
    }
    assert found["false_per_1000", "untouched"].clusters == 100
    # Two of 100 frames under a fault would be seen in a mean over all cases.
    assert found["ospa_mm", "all"].value == pytest.approx(3 / 101)
    assert found["ospa_mm", "untouched:dim"].value == pytest.approx(2 * 3 / 50)


def test_failures_are_counted_by_family_and_score_as_misses() -> None:
    base = trials({"plain:0": [0.1] * 4, "shift:1": [0.1] * 4})
    gone = tuple(contacts() if k in (4, 5, 6) else p for k, p in enumerate(base.predictions))
    failed = np.array([0, 0, 0, 0, RAISED, RAISED, NOT_FINITE, 0], np.int8)
    made = Trials(base.truth, gone, base.press, base.group, axes=(AXIS,), failed=failed)
    found = rows(made)
    assert found["raised", "shift"].value == 2
    assert found["not_finite", "shift"].value == 1
    assert found["raised", "all"].value == 2
    assert (found["raised", "all"].n, found["raised", "all"].unit) == (8, "frames")
    assert found["missed", "shift:1"].value == pytest.approx(0.75)
    assert found["ospa_mm", "shift:1"].value == pytest.approx((3 * 3 + 0.1) / 4)
    assert rows(base, "raised")["raised", "all"].value is None  # a failure would have ended the run
    with pytest.raises(ValueError, match="failed has 3 entries for 8 trials"):
        Trials(base.truth, gone, base.press, base.group, failed=failed[:3])
