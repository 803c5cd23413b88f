"""Dominance with intervals, the line of the best, and what does not belong on one picture."""

from __future__ import annotations

import pytest
from changed_record import changed_record
from hypothesis import given
from hypothesis import strategies as st

from tactibench.board import (
    Point,
    Range,
    counts,
    curves,
    elsewhere_frontiers,
    frontiers,
    line,
    new_sensor_curves,
    ranking_error,
    row_anchor,
    rows_of,
)

ERROR = ranking_error("exp1")


def one(records, **more):
    (found,) = frontiers(rows_of(records), ERROR, **more)
    return found


def test_dominated_means_better_on_both_by_more_than_the_intervals(fabricate):
    records = [
        fabricate(settings={"width": 8}, error=0.05, p90_ms=2.0),
        fabricate(settings={"width": 16}, error=0.10, p90_ms=3.0),  # beaten on both
        fabricate(settings={"width": 32}, error=0.055, p90_ms=3.0),  # errors overlap
        fabricate(settings={"width": 64}, error=0.02, p90_ms=9.0),
        fabricate(model="cnn", encoder=None, error=0.10, p90_ms=2.05),  # times overlap
    ]
    found = one(records)
    assert found.dominated == {"unet, width=16": ("unet, width=8",)}
    verdicts = {point.label: found.verdict(point) for point in found.points}
    assert verdicts == {
        "unet, width=8": "frontier",
        "unet, width=16": "dominated by unet, width=8",
        "unet, width=32": "not dominated",
        "unet, width=64": "frontier",
        "cnn": "not dominated",
    }
    assert [point.label for point in found.best] == [
        "unet, width=8",
        "unet, width=64",
    ]


def test_the_ranges_are_the_envelope_of_the_seeds(fabricate):
    records = [fabricate(error=0.04, p90_ms=2.0, seed=0), fabricate(error=0.06, p90_ms=3.0, seed=1)]
    (point,) = one(records).points
    assert (point.error.low, point.error.value, point.error.high) == pytest.approx(
        (0.036, 0.05, 0.066)
    )
    assert (point.latency.low, point.latency.value, point.latency.high) == (2.0, 2.5, 3.0)
    (single,) = one(records[:1]).points
    assert (single.latency.low, single.latency.high) == pytest.approx((1.96, 2.04))


def test_one_machine_only_the_others_are_counted(fabricate):
    records = [
        fabricate(seed=0),
        fabricate(seed=1),
        fabricate(seed=2, machine="other"),
        fabricate(model="cnn", machine="other"),
    ]
    found = one(records)
    assert (found.machine, found.elsewhere, len(found.points)) == ("0123456789ab", 2, 1)
    assert len(found.points[0].row.records) == 2
    other = one(records, wanted="other")
    assert (other.elsewhere, len(other.points)) == (2, 2)


def test_rows_without_an_error_or_a_time_are_named(fabricate):
    records = [fabricate(), fabricate(model="cnn", error=None), fabricate(model="vgnn", speed=[])]
    assert one(records).untimed == ("cnn", "vgnn")


def test_regimes_have_frontiers_of_their_own_and_trivial_rows_none(fabricate):
    records = [fabricate(), fabricate(regime="multiple"), fabricate(model="mean", p90_ms=0.001)]
    found = frontiers(rows_of(records), ERROR)
    assert [(one.regime, len(one.points)) for one in found] == [("single", 1), ("multiple", 1)]
    assert frontiers(rows_of(records[2:]), ERROR) == []


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), max_size=12))
def test_the_line_is_the_pareto_front_of_the_central_values(pairs):
    points = [Point(None, Range(x, x, x), Range(y, y, y)) for x, y in pairs]
    best = {(p.latency.value, p.error.value) for p in line(points)}
    expected = {
        (x, y)
        for x, y in pairs
        if not any(a <= x and b <= y and (a, b) != (x, y) for a, b in pairs)
    }
    assert best == expected


def test_a_curve_needs_two_numbers_of_presses(fabricate):
    few = [
        fabricate(error=0.2, seed=k, limits={"presses": 250}, data={"train": 250}) for k in range(2)
    ]
    rows = rows_of([fabricate(), *few, fabricate(model="cnn")])
    (curve,) = curves(rows, ERROR)
    assert curve.label == "unet"
    assert [(step.presses, step.seeds) for step in curve.steps] == [(250, 2), (3600, 1)]
    assert counts([curve]) == [250, 3600]


def on_instance(fabricate, instance, shots, error, seed=0, count=16):
    """A record of a model that was trained on others and shown so many presses of an instance."""
    record = fabricate(sensor={"instances": count}, error=error, seed=seed)
    tested = {
        "name": "tactip-127",
        "parameters": {"instance": instance, "instances": 0, "tier": "auto"},
        "asked": [f"sensor.instance={instance}", *([f"shots={shots}"] if shots else [])],
        "on": f"another individual (instance={instance})",
        "presses": 1000,
    }
    return changed_record(record, {"sensor.tested": tested})


def test_a_new_sensor_is_a_mean_over_instances_and_each_over_its_seeds(fabricate):
    adapted = [
        on_instance(fabricate, instance, shots, error, seed)
        for instance, shots, seed, error in [
            *((1, 0, 0, 0.10), (1, 0, 1, 0.20), (2, 0, 0, 0.35)),
            *((1, 50, 0, 0.04), (2, 50, 0, 0.08)),
        ]
    ]
    alone = [
        fabricate(
            sensor={"instance": instance},
            error=error,
            limits={"presses": presses},
            data={"train": presses},
        )
        for instance, presses, error in [
            *((1, 50, 0.9), (2, 50, 0.7), (1, 200, 0.3), (2, 200, 0.3)),
            *((1, 1000, 0.1), (9, 50, 99.0)),
        ]
    ]
    found = new_sensor_curves([*adapted, *alone, fabricate()], ERROR, "tactip-127")
    steps = {
        curve.label: [(s.presses, s.error.value, s.error.low, s.error.high) for s in curve.steps]
        for curve in found
    }
    name = "unet, "
    assert list(steps) == [f"{name}trained on 16 others", f"{name}this sensor alone"]
    assert steps[f"{name}trained on 16 others"] == [
        pytest.approx((0, 0.25, 0.15, 0.35)),
        pytest.approx((50, 0.06, 0.04, 0.08)),
    ]
    assert steps[f"{name}this sensor alone"] == [
        pytest.approx((50, 0.8, 0.7, 0.9)),
        pytest.approx((200, 0.3, 0.3, 0.3)),
    ]
    assert new_sensor_curves([*adapted, *alone], ERROR, "tactip-331") == []
    assert new_sensor_curves([*alone, fabricate()], ERROR, "tactip-127") == []


def test_off_nominal_points_have_the_nominal_times_and_their_own_errors(fabricate):
    nominal = [
        fabricate(settings={"width": 8}, error=0.05, p90_ms=2.0),
        fabricate(settings={"width": 16}, error=0.02, p90_ms=3.0),
        fabricate(model="cnn", encoder=None, error=0.10, p90_ms=1.0),
    ]
    elsewhere = [
        fabricate(settings={"width": 8}, error=0.3, p90_ms=99.0, sensor={"instance": 1}),
        fabricate(settings={"width": 16}, error=0.9, p90_ms=99.0, sensor={"instance": 1}),
        fabricate(model="mean", encoder=None, error=0.1, sensor={"instance": 1}),
    ]
    (moved,) = elsewhere_frontiers([one(nominal)], rows_of(elsewhere), ERROR)
    points = {p.label: (p.latency.value, p.error.value) for p in moved.points}
    assert points == {"unet, width=8": (2.0, 0.3), "unet, width=16": (3.0, 0.9)}
    assert [point.label for point in moved.best] == ["unet, width=8"]
    assert set(moved.dominated) == {"unet, width=16"}


def test_a_link_to_a_row_stays_when_seeds_are_added_and_differs_between_rows(fabricate):
    (before,) = rows_of([fabricate()])
    (after,) = rows_of([fabricate(seed=1), fabricate()])
    assert row_anchor(before) == row_anchor(after)
    others = [
        fabricate(settings={"width": 8}),
        fabricate(regime="multiple"),
        fabricate(sensor={"instance": 1}),
        fabricate("exp2"),
    ]
    names = {row_anchor(row) for row in (before, *rows_of(others))}
    assert len(names) == 5
    assert all(name.startswith("unet-") and name.isascii() for name in names)
