"""``tactibench run``, ``score``, ``speed``: ten lines, --full, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from changed_record import listed_tables

from tactibench.cli.main import main
from tactibench.cli.output import Terminal
from tactibench.records import Record, with_checksum
from tactibench.report import ProgressLines
from tactibench.run import NullReporter, timing

RUN = "run exp1 --model nearest --quick --limit 3 --device cpu --param sensor.size=64"


@pytest.mark.long
def test_a_run_prints_ten_lines_and_is_scored_again(cli: Callable[..., Any]) -> None:
    code, first, err = cli(RUN)
    assert (code, err) == (0, "")
    plan, results = first.splitlines()[:3], first.splitlines()[3:]
    assert plan[0].startswith("plan: exp1-nearest-single-quick-")
    assert len(results) <= 15  # two of them: partial, and no interval
    assert not any(line.startswith("published") for line in results)
    full = cli(f"{RUN} --full")[1]
    for text in ("published: ", "Also measured", "scenario", "record: ", "place: "):
        assert text in full
    quiet = cli(f"{RUN} --quiet")
    assert quiet == cli(f"--quiet {RUN}")
    assert quiet[1].splitlines() == results
    (folder,) = (path for path in Path("runs").iterdir() if path.is_dir())
    code, out, err = cli("score", folder.name, "--json", "again.json")
    assert (code, err) == (0, "")
    assert out.splitlines()[: len(results)] == results
    assert "rows are identical to the stored ones" in out
    record = json.loads((folder / "record.json").read_text())
    assert json.loads(Path("again.json").read_text()) == record

    record = listed_tables((folder / "record.json").read_text())
    row = next(row for row in record["metrics"] if row["metric"] == "spurious")
    row |= {"value": 0.5, "low": 0.4, "high": 0.6}
    (folder / "record.json").write_text(json.dumps(with_checksum(record)))
    code, out, _ = cli("score", folder.name)
    assert code == 1
    assert "spurious of all: stored" in out
    (folder / "truth.npz").write_bytes(b"PK")
    assert "truth.npz" in cli("score", folder.name)[2]
    (folder / "record.json").write_text("{")
    assert "record.json" in cli("score", folder.name)[2]


@pytest.mark.long
def test_several_models_and_seeds_are_ranked_among_each_other(cli: Callable[..., Any]) -> None:
    both = RUN.replace("nearest", "nearest,mean")
    code, out, err = cli(f"{both} --seeds 0,1 --json all.json --quiet")
    assert (code, err) == (0, "")
    records = json.loads(Path("all.json").read_text())
    made = [(record["model"]["name"], record["seed"]) for record in records]
    assert made == [("nearest", 0), ("nearest", 1), ("mean", 0), ("mean", 1)]
    rows = out[out.index("rank  model") :].splitlines()
    assert [row.split()[1] for row in rows[1:3]] == ["nearest", "mean"]
    assert "2 rows have no rank" in out  # 3 presses
    code, _, err = cli(f"{RUN} --seeds 0,one")
    assert code == 2
    assert "'0,one' is no list of seeds; write 0 or 0,1,2" in err
    # No run begins before all requests are understood.
    assert "unknown model 'nosuch'" in cli(RUN.replace("nearest", "mean,nosuch"))[2]


def test_quiet_shows_no_progress() -> None:
    with main.make_context("tactibench", ["--quiet", "doctor"]) as context, context:
        assert Terminal().quiet
        assert isinstance(Terminal()._progress, NullReporter)
    assert isinstance(Terminal()._progress, ProgressLines)


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "planned", "signed"),
    [
        ("exp3 --model mean --test reference", "on finite-element scenes", "|test:reference|"),
        (
            "exp1 --model nearest --param sensor.instances=4 --test sensor.instance=3",
            "on another individual (instance=3)",
            "sensor:tactip-127(instances=4,size=64)",
        ),
    ],
)
def test_a_model_is_tested_on_other_frames(
    cli: Any, tmp_path: Path, options: str, planned: str, signed: str
) -> None:
    code, out, err = cli(
        f"run {options} --quick --device cpu --param sensor.size=64 --json {tmp_path / 'run.json'}"
    )
    assert (code, err) == (0, "")
    assert f"test:  {planned}: generate" in out
    record = Record.model_validate_json((tmp_path / "run.json").read_text())
    assert signed in record.signature
    assert record.test_sensor is not None
    assert record.test_sensor.parameters["instances"] == 0
    code, again, err = cli("score", record.name)
    assert (code, err) == (0, "")
    assert ("trained on 4 instances" in " ".join(again.split())) == ("instances=4" in signed)


@pytest.mark.long
def test_models_are_timed_in_turns(
    monkeypatch: pytest.MonkeyPatch, cli: Any, tmp_path: Path
) -> None:
    monkeypatch.setattr(timing, "BATCHES", (1, 4))
    monkeypatch.setattr(timing, "all_threads", lambda: 1)
    code, out, err = cli(
        "speed mean nearest --train --frames 3 --calls 10 --device cpu --json speed.json"
    )
    assert code == 0, err
    assert out.startswith("exp1 on cpu; ")
    for name in ("mean", "nearest"):
        assert (
            sum(line.startswith(f"{name} ") and " total " in line for line in out.splitlines()) == 3
        )
    rows = json.loads((tmp_path / "speed.json").read_text(encoding="utf-8"))["speed"]
    assert {(row["model"], row["scenario"], row["batch"]) for row in rows} == {
        (model, scenario, batch)
        for model in ("mean", "nearest")
        for scenario, batch in (("single", 1), ("offline", 1), ("offline", 4))
    }


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("speed unet --protocol exp2", "tactibench run exp2 --model unet --train-only"),
        ("speed mean mean --train", "named twice"),
        ("demo --no-browser mean nearest cnn", "3 models are named; the page shows 2 at most"),
        ("demo --no-browser unet", "there are no trained weights of unet in the cache"),
        ("demo --no-browser superpose --sensor tactip", "'tactip' cannot be pressed by mouse"),
        (
            "demo --no-browser cnn --protocol surface --data .",
            "'recorded' cannot be pressed by mouse",
        ),
        ("run exp2 --model nearest --test refrence --dry-run", "did you mean 'reference'?"),
        (
            "run exp2 --model nearest --hidden-seed --test sensor.instance=0 --dry-run",
            "what the training frames are made with",
        ),
        (
            "run exp2 --model nearest --test reference --param sensor.instance=3 --dry-run",
            "scenes are of the nominal dome",
        ),
        (
            "run exp2 --model nearest --sensor tactip-127-fem --dry-run",
            "use --sensor tactip-127 --test reference",
        ),
    ],
)
def test_a_mistake_gets_one_sentence(refused: Any, command: str, named: str) -> None:
    assert named in refused(command)
