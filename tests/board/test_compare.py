"""Stored runs against each other: the same presses, pairing, Holm, misses beside the errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from stored_answers import answered_parts, store_run

from tactibench import UserError
from tactibench.board import compare_runs, comparison_rows, left_out
from tactibench.contacts import Contacts, PlatePose
from tactibench.records import pack_contacts, pack_plates, unpack_contacts
from tactibench.stats import holm


@pytest.fixture
def stored(tmp_path, fabricate):
    """Name, errors along x of every frame (None: not answered) -> a run of exp1."""

    def made(name, errors, **more):
        parts = answered_parts(frames=len(errors))
        truth = unpack_contacts(parts["truth"])
        parts["predictions"] = pack_contacts(
            [
                Contacts.none() if e is None else Contacts.truth(t.xy + np.array([e, 0]), t.depth)
                for t, e in zip(truth, errors, strict=True)
            ]
        )
        record = fabricate(model=name, name=f"exp1-{name}", encoder=None, **more)
        return store_run(tmp_path / "runs", record, parts)

    return made


def cell(one, metric, group="all"):
    return next(row for row in one.rows if (row.metric, row.group) == (metric, group))


def test_the_paired_t_interval_and_the_means(stored) -> None:
    rng = np.random.default_rng(0)
    a = rng.gamma(2, 0.05, 40)
    b = a + rng.normal(0.01, 0.01, 40)
    (one,) = compare_runs([stored("a", a), stored("b", b)])
    row = cell(one, "mae_mm")
    expected = stats.ttest_rel(np.abs(a) / 3, np.abs(b) / 3)  # y and depth are exact
    ends = expected.confidence_interval(0.95)
    assert (row.difference.low, row.difference.high) == pytest.approx(tuple(ends))
    assert (row.first, row.second) == pytest.approx((np.abs(a).mean() / 3, np.abs(b).mean() / 3))
    assert row.p == pytest.approx(expected.pvalue, abs=0.01)
    assert row.alone == (0, 0)
    assert row.misses == (0.01, 0.01)  # as the records say
    assert cell(one, "missed").misses is None


def test_presses_that_one_alone_answered_are_counted_and_left_out(stored) -> None:
    a, b = [0.3, None, 0.3, 0.3], [0.6, 0.6, None, 0.6]
    (one,) = compare_runs([stored("a", a), stored("b", b)])
    row = cell(one, "mae_mm")
    assert (row.difference.clusters, row.alone) == (2, (1, 1))
    assert row.difference.value == pytest.approx(-0.1)
    assert cell(one, "missed").difference.value == 0  # one of four either way


def test_holm_over_all_that_is_shown(stored) -> None:
    rng = np.random.default_rng(1)
    runs = [stored(name, rng.normal(0.1 * k, 0.05, 30)) for k, name in enumerate("abc")]
    found = compare_runs(runs)
    assert [(one.first, one.second) for one in found] == [(0, 1), (0, 2), (1, 2)]
    p = [row.p for one in found for row in one.rows]
    assert [row.p_holm for one in found for row in one.rows] == pytest.approx(holm(p))
    assert len(p) == 15
    again = compare_runs(runs)
    assert [row.p for one in again for row in one.rows] == p


def test_one_press_has_no_p_and_nothing_shared_no_value(stored) -> None:
    (one,) = compare_runs([stored("a", [0.1]), stored("b", [0.2])])
    row = cell(one, "mae_mm")
    assert (row.p, row.p_holm, row.difference.low) == (None, None, None)
    (one,) = compare_runs([stored("c", [0.1, None]), stored("d", [None, 0.2])])
    row = cell(one, "mae_mm")
    assert (row.first, row.difference.value, row.p) == (None, None, None)


def test_tidy_rows_and_what_is_no_mean(stored) -> None:
    runs = [stored("a", [0.1, 0.2, 0.3]), stored("b", [0.2, 0.2, 0.2])]
    rows = comparison_rows(runs, compare_runs(runs))
    assert {(r["first"], r["second"]) for r in rows} == {("exp1-a", "exp1-b")}
    names = {"mae_mm", "gospa_depth_mm", "gospa1_mm", "missed", "spurious"}
    # No model states a deviation, so that `nll` and the ellipses have no rows.
    assert {r["metric"] for r in rows} == names
    assert set(left_out(runs)) == {
        "r2",
        "rmse_mm",
        "rmse_pooled_mm",
        "surface_rmse_mm",
        "surface_floor_mm",
        "surface_excess_mm",
        "rmse_over_bound",
        "rms_z",
        "std_over_bound",
    }


def test_runs_that_cannot_be_compared(stored, fabricate) -> None:
    a = stored("a", [0.1, 0.2])
    with pytest.raises(UserError, match="run 'exp1-a' is named twice"):
        compare_runs([a, a])
    other = stored("b", [0.1, 0.2])
    other.record.protocol.version, other.record.protocol.hash = 4, "feed" * 4
    with pytest.raises(UserError, match=r"exp1-a answers exp1@3 .* but exp1-b exp1@4 \(feedfeed\)"):
        compare_runs([a, other])
    other = stored("c", [0.1, 0.2], sensor={"instance": 2})
    with pytest.raises(UserError, match="were not tested on the same frames"):
        compare_runs([a, other])


def test_answers_after_more_labelled_frames_are_compared_apart(tmp_path, fabricate) -> None:
    """Frames of ``transfer`` are answered several times; no mean mixes these answers."""
    truth = [PlatePose(depth, 0.0) for depth in (1.0, 2.0, 3.0)]
    parts = answered_parts()
    parts["truth"] = {
        **pack_plates(truth * 2),
        "press": np.array(["a", "b", "c"] * 2),
        "group": np.array(["0"] * 3 + ["10"] * 3),
    }

    def run(name, errors):
        off = [PlatePose(t.depth + e, 0.0) for e, t in zip(errors, truth * 2, strict=True)]
        own = {**parts, "predictions": pack_plates(off)}
        record = fabricate("transfer", model=name, name=f"transfer-{name}", encoder=None)
        return store_run(tmp_path / "runs", record, own)

    (one,) = compare_runs([run("a", [0.3, 0.4, 0.5, 0.1, 0.1, 0.1]), run("b", [0.2] * 6)])
    none, ten = (cell(one, "depth_mae_mm", group) for group in ("0", "10"))
    assert (none.first, ten.first) == pytest.approx((0.4, 0.1))
    assert (none.difference.value, ten.difference.value) == pytest.approx((0.2, -0.1))
    assert {row.group for row in one.rows} == {"0", "10"}
