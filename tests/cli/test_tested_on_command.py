"""``run --test`` on the command line: what it plans, prints and refuses."""

from __future__ import annotations

from typing import Any

import pytest

pytestmark = pytest.mark.long

NEAREST = ("run", "exp2", "--model", "nearest")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--test", "refrence"], ["'refrence'", "did you mean 'reference'?"]),
        (["--test", "instance=1"], ["changes no sensor", "sensor.instance=1"]),
        (["--test", "sensor.instanse=1"], ["no parameter 'instanse'", "did you mean 'instance'?"]),
        (["--test", "sensor.instance=x"], ["must be a whole number"]),
        (["--test", "sensor.instance=0"], ["what the training frames are made with already"]),
        (["--test", "reference", "--sensor", "planar-grid"], ["no reference scenes", "tactip-127"]),
        (
            ["--test", "reference", "--param", "sensor.instance=3"],
            ["scenes are of the nominal dome", "sensor.instance=3"],
        ),
        (["--test", "reference", "--test", "sensor.tier=auto"], ["no parameter 'tier'"]),
        (["--sensor", "tactip-127-fem"], ["use --sensor tactip-127 --test reference"]),
    ],
    ids=str,
)
def test_mistakes(refused: Any, arguments: list[str], words: list[str]) -> None:
    sentence = refused(*NEAREST, *arguments, "--dry-run")
    for word in words:
        assert word in sentence


def test_a_recording_is_refused(refused: Any, tmp_path: Any) -> None:
    given = ("run", "surface", "--model", "nearest", "--data", tmp_path, "--test", "reference")
    assert "can press no others; leave --test out" in refused(*given)


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
