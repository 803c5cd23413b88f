"""``tactibench doctor --determinism`` finds out what is not the same every time."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_distribution import fake_distribution
from few_presses import few_presses

from tactibench.cli.main import call
from tactibench.errors import UserError
from tactibench.report.determinism_report import verdict
from tactibench.run.evidence import Asked
from tactibench.run.repeated import ALONE, TWO, Finding, repeat, steps

TESTS = Path(__file__).parents[1]
FRAMES = ["frames, fit", "frames, validation", "frames, test"]


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Asked]:
    """Model, sensor -> what is repeated: few presses with a plugin that other processes see."""
    site = tmp_path / "site"
    fake_distribution(site, "unsteady-tactile", unsteady="unsteady_tactile.hooks")
    folders = [site, TESTS / "determinism/fake", TESTS / "run/fake"]
    before = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*map(str, folders), before]))
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.chdir(tmp_path)
    protocol = few_presses(tmp_path / "protocols")["exp1"]
    return lambda model, sensor="still": Asked(model, str(protocol), sensor)


def differing(found: list[Finding]) -> list[str]:
    return [row.what for row in found if not row.same]


def test_what_is_the_same_is_said_to_be(asked: Any, tmp_path: Path) -> None:
    told: list[int] = []
    found = repeat(asked("steady"), told.append)
    assert [row.what for row in found] == [*FRAMES, "weights", "answers", "metrics"]
    assert not differing(found)
    assert [len(row.hashes) for row in found] == [4, 4, 4, 3, 3, 3]
    assert sum(told) == steps()
    assert len({next(iter(row.hashes.values())) for row in found}) == len(found)
    assert not (tmp_path / "cache").exists(), "every time has a cache of its own"


def test_a_training_that_rolls_the_systems_dice_is_found_out(asked: Any) -> None:
    assert differing(repeat(asked("shaky"))) == ["weights", "answers", "metrics"]


@pytest.mark.slow
def test_answers_by_the_order_of_a_set_are_found_out(asked: Any) -> None:
    found = repeat(asked("moody"))
    assert differing(found) == ["answers", "metrics"]
    assert [row.same for row in found if row.what == "weights"] == [True]


def test_frames_that_differ_with_the_threads_are_found_out(
    asked: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    what = asked("steady", "threaded")
    code = call(
        [
            "doctor",
            "--determinism",
            "--model",
            what.model,
            "--protocol",
            what.protocol,
            "--sensor",
            what.sensor,
            "--json",
            str(tmp_path / "found.json"),
        ]
    )
    out = capsys.readouterr().out
    assert code == 1
    assert "NOT THE SAME: steady: frames, fit; steady: frames, validation" in " ".join(out.split())
    assert "on 2 threads" in out
    rows = {
        row["what"]: row for row in json.loads((tmp_path / "found.json").read_text())["findings"]
    }
    assert not rows["frames, fit"]["same"]
    assert set(rows["frames, fit"]["hashes"]) == {ALONE, *TWO, "on 2 threads"}
    assert rows["weights"]["same"], "trained on the same frames"


def test_a_process_that_fails_is_told_in_its_own_words(asked: Any) -> None:
    with pytest.raises(UserError, match="'alone' ended with code 1: ZeroDivisionError"):
        repeat(asked("ill"))


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--model", "cnn"), "belong to --determinism"),
        (("--determinism", "--model", "cnm"), "did you mean 'cnn'"),
        (("--determinism", "--protocol", "stability"), "changes sensors while it tests"),
    ],
)
def test_a_mistake_gets_one_sentence(
    asked: Any, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], named: str
) -> None:
    assert call(["doctor", *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert named in printed.err
    assert printed.err.count("\n") == 1


def test_the_verdict_names_what_differs() -> None:
    same = Finding("m", "weights", {"alone": "a", "again": "a"})
    other = Finding("m", "answers", {"alone": "a", "again": "b"})
    assert verdict([same]) == "the same bits every time"
    assert verdict([same, other]) == "NOT THE SAME: m: answers"
