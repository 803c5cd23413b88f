"""``run --test`` on the command line: what it plans, prints and refuses."""

from __future__ import annotations

from typing import Any

import pytest

from tactibench.records import Record

pytestmark = pytest.mark.long

NEAREST = ("run", "exp2", "--model", "nearest")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--test", "refrence"], ["'refrence'", "did you mean 'reference'?"]),
        (["--test", "instance=1"], ["changes no sensor", "sensor.instance=1"]),
        (
            ["--hidden-seed", "--test", "sensor.instance=0"],
            ["what the training frames are made with"],
        ),
        (["--test", "reference", "--sensor", "planar-grid"], ["no reference scenes", "tactip-127"]),
        (
            ["--test", "reference", "--param", "sensor.instance=3"],
            ["scenes are of the nominal dome", "sensor.instance=3"],
        ),
        (
            ["--param", "sensor.instances=4", "--test", "sensor.instances=2"],
            ["the instances that models are trained on", "sensor.instance=K"],
        ),
        (["--sensor", "tactip-127-fem"], ["use --sensor tactip-127 --test reference"]),
    ],
    ids=str,
)
def test_mistakes(refused: Any, arguments: list[str], words: list[str]) -> None:
    sentence = refused(*NEAREST, *arguments, "--dry-run")
    for word in words:
        assert word in sentence
    assert "--test hidden" not in sentence, "the option is --hidden-seed"


def test_a_run_on_reference_scenes_is_printed_and_may_stand_on_a_board(
    cli: Any, tmp_path: Any
) -> None:
    code, out, err = cli(
        "run exp3 --model mean --quick --device cpu --test reference --param sensor.size=64"
    )
    assert (code, err) == (0, "")
    assert "test:  on finite-element scenes: generate" in out
    assert "sensor tactip-127, tested on" in out
    assert "|test:reference|" in out
    (run,) = (path.parent for path in (tmp_path / "runs").glob("*/record.json"))
    assert "-on-reference-s0-" in run.name
    assert cli("score", run.name)[0] == 0


@pytest.mark.parametrize(
    ("test", "on", "instance"),
    [
        (" --test sensor.instance=3", "another individual (instance=3)", 3),
    ],
)
def test_a_model_of_many_instances_is_tested_on_one(
    cli: Any, tmp_path: Any, test: str, on: str, instance: int
) -> None:
    code, out, err = cli(
        "run exp1 --model nearest --quick --device cpu --param sensor.size=64 "
        f"--param sensor.instances=4 --json {tmp_path / 'run.json'}{test}"
    )
    assert (code, err) == (0, "")
    assert f"test:  on {on}: generate" in out
    assert "trained on 4 instances" in " ".join(out.split())
    record = Record.model_validate_json((tmp_path / "run.json").read_text())
    assert record.sensor.parameters["instances"] == 4
    assert "instances" in record.sensor.settings
    assert record.test_sensor is not None
    assert record.test_sensor.description == on
    assert record.test_sensor.parameters["instances"] == 0
    assert record.test_sensor.parameters["instance"] == instance
    described = record.identity.sensor["describe"]["instances"]
    assert (described["count"], described["numbers"]) == (4, [10, 13])
    assert "sensor:tactip-127(instances=4,size=64)" in record.signature
    code, again, err = cli(f"score {record.name}")
    assert (code, err) == (0, "")
    assert "trained on 4 instances" in " ".join(again.split())
