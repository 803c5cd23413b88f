"""The overview: one line a model, joined over the boards of several protocols."""

from __future__ import annotations

from tactibench.board import overview
from tactibench.protocols import overview_spec
from tactibench.records.record import RecordingId
from tactibench.report import overview_table

NAMES = [column.name for column in overview_spec().columns]


def values_of(line):
    found = zip(NAMES, line.values, strict=True)
    return {name: None if value is None else value.value for name, value in found}


def on_exp1(fabricate, model, unseen, **more):
    own = (("gospa_depth_mm", "unseen", unseen),)
    return fabricate("exp1", model, error=0.02, metrics=own, **more)


def on_plates(fabricate, column, model, error):
    """A record of the real recording of a column."""
    record = fabricate("surface", model, regime="recorded", origin="real", error=error)
    digits = overview_spec().columns[NAMES.index(column)].recording
    record.sensor.recording = RecordingId(label=column, sha256=digits + 56 * "0")
    record.identity.data = [column]
    return record


def test_lines_are_in_the_order_of_a_real_sensor_and_then_of_unseen_ones(fabricate):
    records = [
        on_exp1(fabricate, "a", 0.9),
        on_exp1(fabricate, "b", 0.1),
        on_exp1(fabricate, "mean", 0.01),
        on_exp1(fabricate, "c", None),
        on_exp1(fabricate, "d", 0.95),
    ]
    lines = overview({"exp1": records, "surface": [on_plates(fabricate, "plates", "d", 0.02)]})
    assert [line.row.first.model.name for line in lines] == [*"dbac", "mean"]


def test_a_line_joins_the_rows_of_one_training(fabricate):
    boards = {
        "exp1": [on_exp1(fabricate, "a", 0.9, seed=seed) for seed in (0, 1)],
        "exp2": [
            fabricate("exp2", "a", metrics=(("resolved", "all", 0.5),)),
            fabricate("exp2", "a", encoder="offset", metrics=(("resolved", "all", 0.1),)),
            fabricate("exp2", "a", regime="multiple", metrics=(("resolved", "all", 0.2),)),
            fabricate("exp2", "a", sensor={"instances": 64}, metrics=(("resolved", "all", 0.3),)),
        ],
        "stability": [fabricate("stability", "a", error=0.4)],
        "exp3": [
            fabricate(
                "exp3", "a", settings={"width": 8}, metrics=(("gospa_depth_mm", "heldout", 1.0),)
            )
        ],
    }
    (line,) = overview(boards)
    assert values_of(line) == {
        "nominal": 0.02,
        "unseen": 0.9,
        "pairs": 0.5,
        "heldout": None,
        "plates": None,
        "plates-127": None,
        "hard": 0.4,
    }
    assert line.row.seeds == (0, 1)


def test_real_plates_are_those_of_their_recording(fabricate):
    errors = {"plates": 0.02, "plates-127": 0.03}
    plates = [on_plates(fabricate, column, "a", error) for column, error in errors.items()]
    (line,) = overview({"exp1": [on_exp1(fabricate, "a", 0.9)], "surface": plates})
    found = values_of(line)
    assert (found["plates"], found["plates-127"]) == (0.02, 0.03)


def test_the_short_table_has_models_at_their_defaults_in_six_columns(fabricate):
    records = [
        on_exp1(fabricate, "a", 0.9),
        on_exp1(fabricate, "a", 0.1, sensor={"instances": 64}),
        on_exp1(fabricate, "a", 0.2, settings={"width": 8}),
        on_exp1(fabricate, "mean", 0.3),
    ]
    shown = overview_table(overview({"exp1": records}), brief=True)
    assert len(shown.columns) == 6
    assert [(row[0].text, row[0].style) for row in shown.rows] == [("a", ""), ("mean", "italic")]


def test_a_table_of_it_names_the_sensor_of_the_training_where_it_is_another(fabricate):
    records = [
        on_exp1(fabricate, "a", 0.9),
        on_exp1(fabricate, "a", 0.1, sensor={"instances": 64}),
    ]
    shown = overview_table(overview({"exp1": records}), link=lambda anchor: f"#{anchor}")
    names = [cell.text for cell, *_ in shown.rows]
    assert names == [
        "a, trained on tactip-127, instances=64",
        "a",
    ]
    assert all(cell.link.startswith("#a-") for cell, *_ in shown.rows)
