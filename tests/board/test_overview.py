"""The overview: one line a model, joined over the boards of several protocols."""

from __future__ import annotations

from tactibench.board import WorstFamily, overview, rows_of, worst_family
from tactibench.protocols import overview_spec
from tactibench.report import overview_table

NAMES = [column.name for column in overview_spec().columns]


def values_of(line):
    found = zip(NAMES, line.values, strict=True)
    return {name: None if value is None else value.value for name, value in found}


def on_exp1(fabricate, model, unseen, **more):
    own = (("gospa1_mm", "unseen", unseen),)
    return fabricate("exp1", model, error=0.02, metrics=own, **more)


def test_lines_are_in_the_order_of_the_error_off_the_nominal_sensor(fabricate):
    records = [
        on_exp1(fabricate, "a", 0.9),
        on_exp1(fabricate, "b", 0.1),
        on_exp1(fabricate, "mean", 0.01),
        on_exp1(fabricate, "c", None),
    ]
    assert [line.row.first.model.name for line in overview({"exp1": records})] == [*"bac", "mean"]


def test_a_line_joins_the_rows_of_one_training(fabricate):
    boards = {
        "exp1": [on_exp1(fabricate, "a", 0.9, seed=seed) for seed in (0, 1)],
        "exp2": [
            fabricate("exp2", "a", metrics=(("resolved", "all", 0.5),)),
            fabricate("exp2", "a", encoder="offset", metrics=(("resolved", "all", 0.1),)),
            fabricate("exp2", "a", regime="multiple", metrics=(("resolved", "all", 0.2),)),
            fabricate("exp2", "a", sensor={"instances": 64}, metrics=(("resolved", "all", 0.3),)),
        ],
        "exp3": [
            fabricate("exp3", "a", settings={"width": 8}, metrics=(("gospa1_mm", "heldout", 1.0),))
        ],
    }
    (line,) = overview(boards)
    assert values_of(line) == {
        "nominal": 0.02,
        "unseen": 0.9,
        "pairs": 0.5,
        "heldout": None,
        "plates": None,
    }
    assert line.row.seeds == (0, 1)


def test_real_plates_are_those_of_the_published_frames(fabricate):
    plates = []
    for published, error in ((True, 0.02), (False, 0.03)):
        record = fabricate("surface", "a", regime="recorded", origin="real", error=error)
        record.data.published_frames = published
        record.identity.data = [f"published {published}"]
        plates.append(record)
    (line,) = overview({"exp1": [on_exp1(fabricate, "a", 0.9)], "surface": plates})
    assert values_of(line)["plates"] == 0.02


def test_the_worst_family_has_the_largest_mean_error_and_is_no_other_sensor(fabricate):
    cases = (
        ("ospa_mm", "individual:1", 3.0),
        ("ospa_mm", "blur:1", 0.5),
        ("ospa_mm", "blur:2", 1.5),
        ("ospa_mm", "dim:0.5", 1.2),
        ("ospa_mm", "plain:0", 2.9),
    )
    (row,) = rows_of([fabricate("stability", "a", metrics=cases)])
    assert worst_family(row) == WorstFamily("dim", 1.2)
    (none,) = rows_of([fabricate("stability", "b", error=None)])
    assert worst_family(none) is None


def test_a_table_of_it_names_the_sensor_of_the_training_where_it_is_another(fabricate):
    records = [
        on_exp1(fabricate, "a", 0.9),
        on_exp1(fabricate, "a", 0.1, sensor={"instances": 64}),
    ]
    shown = overview_table(overview({"exp1": records}), link=lambda anchor: f"#{anchor}")
    names = [cell.text for cell, *_ in shown.rows]
    assert names == [
        "a + hertz (single), trained on tactip-127, instances=64",
        "a + hertz (single)",
    ]
    assert all(cell.link.startswith("#a-hertz") for cell, *_ in shown.rows)
