"""Published tables: read strictly, and recomputed rather than believed."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench.protocols import PublishedTable, load_published, published_names, rows_for

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


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("year = 2024", "yeer = 2024", "unknown key 'yeer'"),
        ("x = 0.5", "x = nan", "key 'rows.1.metrics.mae_mm.x' is"),
        ("schema_version = 1", "schema_version = 2", "key 'schema_version' is 2"),
        ('name = "paper"', 'name = "other"', "key name"),
        ("year = 2024", "year = = 2024", "is not valid TOML"),
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
