"""``tactibench list runs|weights|published``, and ``run --train-only`` that leaves weights."""

from __future__ import annotations

import json
from pathlib import Path

TRAIN = ("run", "exp1", "--model", "mean", "--presses", "40", "--train-only")


def listed(cli, kind):
    assert cli("list", kind, "--json", "rows.json")[0] == 0
    return json.loads(Path("rows.json").read_text())


def test_trained_weights_are_listed_and_found_again(cli):
    code, out, _ = cli(*TRAIN, "--json", "t.json")
    assert code == 0
    assert out.startswith("mean (single), seed 0: trained 0 epochs on 40 presses in ")
    assert json.loads(Path("t.json").read_text())["reused"] is False
    assert not Path("runs").exists(), "nothing was tested"
    assert "found in the cache" in cli(*TRAIN)[1]
    other = (TRAIN[0], "exp2", *TRAIN[2:])
    assert "found in the cache" in cli(*other)[1], "the experiments share their weights"
    line = next(line for line in cli("list", "weights")[1].split("\n") if line.startswith("mean"))
    assert line.split()[:6] == ["mean", "none", "single", "40", "0", "cpu"]
    (row,) = listed(cli, "weights")
    assert row["bytes"] > 0
    assert (row["model"], row["presses"], row["epochs"]) == ("mean", 40, 0)


def test_runs_of_a_store_are_listed(cli, stored_run):
    assert cli("list", "runs")[1].startswith("no runs in runs")
    name = stored_run()
    assert name in cli("list", "runs")[1]
    (row,) = listed(cli, "runs")
    assert (row["name"], row["protocol"], row["partial"]) == (name, "exp1", False)


def test_published_tables_are_listed_with_what_they_were_measured_on(cli):
    code, out, _ = cli("list", "published")
    assert code == 0
    assert "measured on: hardware TacTip, RTX 5070 Ti" in out
    rows = listed(cli, "published")
    (row,) = [r for r in rows if "coverage" in r["metrics"]]
    assert (row["table"], row["comparable"]) == ("tac-vgnn", "yes")
    assert list(row["metrics"]["coverage"].values()) == [0.968]
