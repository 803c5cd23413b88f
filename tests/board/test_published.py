"""Published tables: read strictly, and recomputed rather than believed."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tactibench import UserError
from tactibench.board.published import (
    PublishedTable,
    aggregation,
    findings,
    load_published,
    mean,
    published_names,
    root_mean_square,
    rows_for,
    target_sd,
    target_sd_range,
    uniform_sd,
)

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "leaderboards" / "published"


@pytest.fixture(scope="module")
def tactiverse() -> PublishedTable:
    return load_published(["tactiverse"], FOLDER)[0]


def row(table, protocol, model, regime="single"):
    (found,) = (r for r in rows_for(protocol, table) if (r.model, r.regime) == (model, regime))
    return found


def test_every_shipped_table_loads_under_its_own_name():
    names = published_names(FOLDER)
    assert {"tac-vgnn", "tactiverse"} <= set(names)
    assert [table.name for table in load_published(names, FOLDER)] == names


@pytest.mark.parametrize("name", ["tactiverse", "tac-vgnn"])
def test_metric_names_are_those_of_a_record(name):
    groups = {
        "exp1": {m: {"mean", "x", "y", "z"} for m in ("r2", "mae_mm", "rmse_mm")},
        "exp2": {"distance_mae_mm": {"all"}},
        "exp3": {m: {"dual", "triple"} for m in ("position_mean_mm", "depth_mae_mm")},
        "surface": {m: {"all"} for m in ("depth_mae_mm", "tilt_mae_deg", "coverage")},
    }
    for r in load_published([name], FOLDER)[0].rows:
        for metric, values in r.metrics.items():
            assert set(values) <= groups[r.protocol][metric]


def test_printed_values_have_no_more_digits_than_declared():
    for table in load_published(published_names(FOLDER), FOLDER):
        for r in table.rows:
            for values in r.metrics.values():
                assert all(round(v, r.decimals) == v for v in values.values())


def test_exp3_keeps_the_two_dual_sets_apart(tactiverse):
    dual = [r for r in rows_for("exp3", tactiverse) if r.value("position_mean_mm", "dual")]
    single = {r.n: r.value("position_mean_mm", "dual") for r in dual if r.regime == "single"}
    assert single == {725: 2.24, 908: 0.408}
    assert len(rows_for("exp3", tactiverse)) == 5


def test_a_value_the_paper_does_not_print_is_none(tactiverse):
    assert row(tactiverse, "exp2", "U-Net").value("resolved", "all") is None
    assert rows_for("surface", tactiverse) == ()


def test_the_two_exp1_rows_average_differently(tactiverse):
    """Recomputed with numpy from the printed axes."""
    kinds = {}
    for model in ("CNN", "U-Net"):
        r = row(tactiverse, "exp1", model)
        axes = np.array([r.metrics["rmse_mm"][axis] for axis in "xyz"])
        stated = r.metrics["rmse_mm"]["mean"]
        near = np.abs([axes.mean() - stated, np.sqrt((axes**2).mean()) - stated]) < 1e-4
        kinds[model] = ["mean", "root mean square"][int(np.flatnonzero(near)[0])]
        assert near.sum() == 1
        assert aggregation(axes.tolist(), stated, r.decimals) == kinds[model]
        mae = [r.metrics["mae_mm"][axis] for axis in "xyz"]
        assert aggregation(mae, r.metrics["mae_mm"]["mean"], r.decimals) == "mean"
    assert kinds == {"CNN": "root mean square", "U-Net": "mean"}
    assert "0.0816" in tactiverse.notes[0]
    assert "0.1313" in tactiverse.notes[0]


def test_the_exp1_rows_cannot_share_their_depths(tactiverse):
    ranges = {}
    for model in ("CNN", "U-Net"):
        r = row(tactiverse, "exp1", model)
        ranges[model] = target_sd_range(r.value("rmse_mm", "z"), r.value("r2", "z"), r.decimals)
    uniform = np.random.default_rng(0).uniform(0.5, 6.0, 400_000).std()
    assert uniform_sd(0.5, 6.0) == pytest.approx(uniform, rel=0.005)
    assert ranges["CNN"][1] < ranges["U-Net"][0]
    assert ranges["U-Net"][1] < uniform_sd(0.5, 6.0)
    for figure in ("0.58", "1.31", "1.59"):
        assert figure in tactiverse.notes[1]
    for model, figure in (("CNN", 0.58), ("U-Net", 1.31)):
        assert ranges[model][0] - 0.005 < figure < ranges[model][1] + 0.005


def test_the_range_of_x_that_the_tables_imply(tactiverse):
    """+-6.4 mm has a spread that both rows' x allow for, to 5 %."""
    for model in ("CNN", "U-Net"):
        r = row(tactiverse, "exp1", model)
        implied = target_sd(r.value("rmse_mm", "x"), r.value("r2", "x"))
        assert uniform_sd(-6.4, 6.4) == pytest.approx(implied, rel=0.05)


def test_findings_hold_every_average_and_every_implied_spread(tactiverse):
    got = {(f.row, f.metric, f.group): f for f in findings(tactiverse)}
    assert len(got) == 2 * (4 + 3)
    z = got["CNN (single)", "target_sd_mm", "z"]
    assert z.low < z.value < z.high
    assert z.value == pytest.approx(0.0558 / (1 - 0.9908) ** 0.5)
    average = got["U-Net (single)", "rmse_mm_average", "mean"]
    assert average.value == pytest.approx((0.1637 + 0.1270 + 0.0938) / 3)
    assert "0.1282, which is mean" in average.note
    assert findings(load_published(["tac-vgnn"], FOLDER)[0]) == []


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 5.0), st.floats(0.01, 0.5))
def test_target_sd_is_the_spread_of_the_targets(seed, spread, noise):
    rng = np.random.default_rng(seed)
    truth = rng.normal(0.0, spread, 50)
    predicted = truth + rng.normal(0.0, noise, 50)
    square = ((truth - predicted) ** 2).mean()
    r2 = 1 - square / truth.var()
    assert target_sd(square**0.5, r2) == pytest.approx(truth.std(), rel=1e-6)


@given(st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3))
def test_aggregation_survives_the_rounding_of_the_print(axes):
    printed = [round(a, 4) for a in axes]
    assert aggregation(printed, round(float(np.mean(axes)), 4), 4) in ("mean", "either")
    square = float(np.sqrt(np.mean(np.square(axes))))
    assert aggregation(printed, round(square, 4), 4) in ("root mean square", "either")
    assert aggregation(printed, round(square, 4) + 0.01, 4) in ("mean", "neither")
    assert mean(axes) <= root_mean_square(axes) * (1 + 1e-12)


@given(st.floats(0.01, 1.0), st.floats(0.9, 0.9999))
def test_target_sd_range_holds_what_was_rounded(rmse, r2):
    low, high = target_sd_range(round(rmse, 4), round(r2, 4), 4)
    assert low <= target_sd(rmse, r2) * (1 + 1e-12)
    assert target_sd(rmse, r2) <= high * (1 + 1e-12)


def test_a_perfect_r2_implies_no_spread():
    with pytest.raises(ValueError, match="below 1"):
        target_sd(0.0, 1.0)
    assert target_sd_range(0.1, 0.99996, 4)[1] == float("inf")


def test_tac_vgnn_figures_are_those_of_the_released_predictions():
    data = Path(os.environ.get("TACTIBENCH_TACVGNN", ROOT.parent / "shared/data/tac-vgnn"))
    if not (data / "published_prediction.csv").is_file():
        pytest.skip(f"the released predictions are not at {data}; set TACTIBENCH_TACVGNN")
    with (data / "published_prediction.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    def column(name: str) -> np.ndarray:
        return np.array([float(r[name].removeprefix("tensor(").rstrip(")")) for r in rows])

    (r,) = rows_for("surface", load_published(["tac-vgnn"], FOLDER)[0])
    assert r.n == len(rows)
    depth = np.abs(column("pred_1") - column("target_1")).mean()
    tilt = np.abs(column("pred_2") - column("target_2")).mean()
    assert r.value("depth_mae_mm", "all") == pytest.approx(depth, abs=0.5e-4)
    assert r.value("tilt_mae_deg", "all") == pytest.approx(tilt, abs=0.5e-3)
    assert r.value("coverage", "all") == 1 - 160 / 5000


GOOD = """
schema_version = 1
name = "paper"
title = "A paper"
authors = "Somebody"
year = 2024
measured_on = "a sensor"
[[rows]]
protocol = "exp1"
model = "M"
source = "Table 1"
decimals = 2
comparable = "no"
note = "why"
metrics = { mae_mm = { x = 0.5 } }
"""


def test_a_table_is_frozen(tmp_path):
    (tmp_path / "paper.toml").write_text(GOOD)
    (table,) = load_published(["paper"], tmp_path)
    assert table.rows[0].label == "M"
    with pytest.raises(ValidationError, match="frozen"):
        table.year = 2025


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("year = 2024", "", "key year"),
        ("year = 2024", "yeer = 2024", "key y"),
        ('title = "A paper"', 'title = "A paper"\nextra = 1', "key extra"),
        ("x = 0.5", "x = nan", "key rows.0.metrics.mae_mm.x"),
        ("x = 0.5", 'x = "half"', "key rows.0.metrics.mae_mm.x"),
        ("{ x = 0.5 }", "{}", "key rows.0.metrics.mae_mm"),
        ('comparable = "no"', 'comparable = "perhaps"', "key rows.0.comparable"),
        ("schema_version = 1", "schema_version = 2", "key schema_version"),
        ('name = "paper"', 'name = "other"', "key name"),
        ("year = 2024", "year = = 2024", "not a TOML file"),
    ],
)
def test_bad_tables_are_one_sentence(tmp_path, old, new, says):
    (tmp_path / "paper.toml").write_text(GOOD.replace(old, new))
    with pytest.raises(UserError) as caught:
        load_published(["paper"], tmp_path)
    text = str(caught.value)
    assert "paper.toml" in text
    assert says in text
    assert "\n" not in text


def test_unknown_table_names_the_close_match():
    with pytest.raises(UserError, match="did you mean 'tactiverse'"):
        load_published(["tactivers"], FOLDER)


def test_a_folder_without_tables(tmp_path):
    with pytest.raises(UserError, match="known: none"):
        load_published(["tactiverse"], tmp_path / "nowhere")
