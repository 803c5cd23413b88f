"""Seeds pooled into rows, rows into sections: means, intervals, spreads, and what never mixes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from changed_record import changed_record
from hypothesis import given
from hypothesis import strategies as st

from tactibench.board import (
    fitted_words,
    label_of,
    latency,
    ordered,
    prior_of,
    read_submission,
    rows_of,
    sections_of,
)
from tactibench.records import FrameCounts, Reproduction, SensorId

COMMITTED = Path(__file__).parents[2] / "leaderboards" / "submissions"


@pytest.mark.parametrize(
    ("facts", "label"),
    [
        ({}, "unet"),
        ({"model": "cnn", "encoder": None}, "cnn"),
        ({"model": "mixture", "encoder": "mixture"}, "mixture"),
        ({"settings": {"width": 32, "mixing": 0.0}}, "unet, width=32, mixing=0.0"),
        ({"encoder": "depth", "regime": "multiple"}, "unet + depth (multiple)"),
        ({"protocol": "surface", "regime": "recorded"}, "unet"),
        ({"protocol": "surface", "regime": "single"}, "unet (single)"),
    ],
)
def test_a_default_is_called_by_its_name_and_a_name_adds_what_differs(fabricate, facts, label):
    record = fabricate(**facts)
    assert label_of(record) == label
    (row,) = rows_of([record])
    assert row.default == (label.partition(" (")[0] == record.model.name)


def test_rows_of_a_protocol_that_is_not_installed_say_all(fabricate):
    record = fabricate()
    record.protocol.id = "elsewhere"
    assert label_of(record) == "unet + hertz (single)"


@given(st.lists(st.floats(0.01, 9.0), min_size=1, max_size=5))
def test_seeds_are_pooled_into_mean_interval_and_spread(fabricate, values):
    records = [fabricate(error=value, seed=k) for k, value in enumerate(values)]
    (row,) = rows_of(reversed(records))
    pooled = row.metric("gospa_depth_mm", "all")
    assert row.seeds == tuple(range(len(values)))
    assert pooled.value == pytest.approx(np.mean(values))
    assert (pooled.low, pooled.high) == pytest.approx(
        (0.9 * np.mean(values), 1.1 * np.mean(values))
    )
    expected = np.std(values, ddof=1) if len(values) > 1 else None
    assert pooled.sd == (None if expected is None else pytest.approx(expected, abs=1e-12))


def test_one_seed_without_a_value_makes_it_n_a(fabricate):
    (row,) = rows_of([fabricate(seed=0), fabricate(seed=1, error=None)])
    assert row.metric("gospa_depth_mm", "all") is None
    assert row.metric("missed", "all") is not None
    assert row.metric("no such metric", "all") is None


def test_seeds_with_a_limit_are_named_beside_the_mean_of_the_others(fabricate):
    records = [fabricate(seed=k, error=value) for k, value in enumerate((2.5, 3.5, 6.5, 6.5))]
    for record in records[2:]:
        record.metrics[0].censored = ">"
    pooled = rows_of(records)[0].metric("gospa_depth_mm", "all")
    assert (pooled.value, pooled.censored, pooled.seeds) == (3.0, None, 2)
    assert pooled.limits == "2 of 4 seeds > 6.5"
    assert pooled.sd == pytest.approx(0.5**0.5)


def test_limits_stay_limits_and_opposite_ones_make_no_mean(fabricate):
    records = [fabricate(seed=k) for k in range(2)]
    for record in records:
        record.metrics[0].censored = "<"
    pooled = rows_of(records)[0].metric("gospa_depth_mm", "all")
    assert (pooled.censored, pooled.sd) == ("<", None)
    records[1].metrics[0].censored = ">"
    assert rows_of(records)[0].metric("gospa_depth_mm", "all") is None


@pytest.mark.parametrize(
    "other",
    [
        {"regime": "multiple"},
        {"settings": {"width": 8}},
        {"encoder": "offset"},
        {"model": "cnn"},
        {"limits": {"presses": 250}},
    ],
)
def test_other_configurations_are_other_rows(fabricate, other):
    assert len(rows_of([fabricate(seed=0), fabricate(seed=1), fabricate(**other)])) == 2


def test_rows_whose_labels_hide_their_difference_are_marked(fabricate):
    hidden = fabricate()
    hidden.model.parameters["new"] = 1
    labels = [row.label for row in rows_of([fabricate(), hidden])]
    assert len(set(labels)) == 2
    assert all(label.startswith("unet #") for label in labels)


def test_no_section_mixes_sensors_origins_or_test_frames(fabricate):
    records = [
        fabricate(),
        fabricate(sensor={"instance": 1}),
        fabricate(origin="real"),
        changed_record(fabricate(), {"identity.data": ["others"]}),
    ]
    sections = sections_of(records)
    assert [section.nominal for section in sections] == [True, True, False, True]
    titles = [section.title for section in sections]
    assert len(set(titles)) == 4
    assert titles[2] == "Simulated sensor tactip-127, instance=1"
    assert titles[-1] == "Real sensor tactip-127"
    assert all(" (test frames " in title for title in titles[:2])


def test_order_is_by_error_with_n_a_after_it_and_trivial_rows_last(fabricate):
    rows = rows_of(
        [
            fabricate(model="mean", encoder=None, error=0.001),
            fabricate(error=0.2),
            fabricate(model="cnn", encoder=None, error=0.1),
            fabricate(model="vgnn", error=None),
        ]
    )
    assert [row.first.model.name for row in ordered("exp1", rows)] == [
        "cnn",
        "unet",
        "vgnn",
        "mean",
    ]
    unknown = [row.label for row in ordered("mine", rows)]
    assert unknown[:2] == ["cnn", "unet"]


def test_latency_is_read_by_threads(fabricate):
    record = fabricate(p90_ms=4.0)
    record.speed[1].p90_ms = 3.0
    assert latency(record, threads=1) == 4.0
    assert latency(record, threads=None) == 3.0
    assert latency(record, threads=7) is None
    assert latency(record.model_copy(update={"speed": []}), threads=None) is None


@pytest.mark.parametrize(("value", "below"), [(0.5, True), (0.97, False), (3.0, False)])
def test_a_row_surely_below_the_bound_is_told(fabricate, value, below):
    """The interval of a fabricated metric is a tenth to either side."""
    (row,) = rows_of([fabricate(metrics=(("rmse_over_bound", "x", value),))])
    assert row.below_bound == below


def test_labelled_frames_of_the_tested_sensor_are_counted_whatever_was_fitted(fabricate):
    described = {"pivot_mm": 20.5, "label_fit": {"presses": 1500}}
    tested = {
        "name": "recorded",
        "parameters": {"pivot_mm": 0.0},
        "asked": ["data=331"],
        "on": "recording 331",
        "presses": 1000,
        "trained_on": "simulated fitted-331",
    }
    sensor = {
        "name": "fitted-331",
        "origin": "simulated",
        "parameters": {},
        "settings": [],
        "tested": tested,
    }
    seen = {"labelled_frames": [0, 200], "left_out_calibrated": 400, "described": described}
    record = fabricate().model_copy(
        update={
            "sensor": SensorId.model_validate(sensor),
            "data": FrameCounts.model_validate({"of_tested_sensor": seen}),
        }
    )
    assert fitted_words(record) == (
        "Offset and pivot of the labels were fitted to 1,500 labelled frames, "
        "the simulated sensor to 400 others, which test nothing."
    )
    assert fitted_words(fabricate()) == ""


def test_a_row_says_who_reproduced_how_many_of_its_runs(fabricate):
    records = [fabricate(seed=seed) for seed in range(3)]
    (row,) = rows_of(records)
    assert row.reproduced == "as submitted"
    note = Reproduction(by="a lab", machine="Xeon (0123)", date="2026-11-27")
    records[0].reproduced = note
    assert row.reproduced == "1 of 3 reproduced by a lab"
    for record in records:
        record.reproduced = note
    assert row.reproduced == "reproduced by a lab"


@pytest.mark.parametrize(
    ("model", "parameters", "regime", "knew"),
    [
        ("unet", {"mixing": -1.0, "neighbours": "dome"}, "single", "nominal mechanics"),
        ("unet", {"mixing": 0.5, "neighbours": "none"}, "single", "plain addition"),
        ("unet", {"mixing": 0.0, "neighbours": "dome"}, "multiple", "none"),
        ("kernel", {"refine": "fields"}, "single", "nominal mechanics"),
        ("superpose", {"neighbours": "dome"}, "multiple", "fitted to multi-contact labels"),
        ("superpose", {"neighbours": "none"}, "single", "plain addition"),
        ("own", {"mixing": 1.0}, "single", "not stated"),
    ],
)
def test_what_a_model_that_ships_knew_follows_from_its_spec(
    fabricate, model, parameters, regime, knew
):
    record = fabricate("exp2", model, encoder=None, regime=regime, settings=parameters)
    record.training.prior = None if model == "own" else "none"  # as a record may say
    assert prior_of(record) == knew


@pytest.mark.parametrize("protocol", sorted(p.name for p in COMMITTED.iterdir()))
def test_committed_rows_state_what_their_specs_say(protocol):
    for path in (COMMITTED / protocol).glob("*.json"):
        record = read_submission(path)
        assert prior_of(record) == record.training.prior, path
