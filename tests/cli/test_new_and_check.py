"""``tactibench new`` and ``tactibench check`` as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


def test_new_says_what_it_wrote_and_what_is_next(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli("new", "model", "ridge")
    assert (code, err) == (0, "")
    folder = tmp_path / "tactibench-ridge"
    written = sorted(
        str(path.relative_to(tmp_path)) for path in folder.rglob("*") if path.is_file()
    )
    assert [line.removeprefix("wrote ") for line in out.splitlines()[:6]] == written
    assert out.splitlines()[6:] == [
        "next:",
        "  pip install -e ./tactibench-ridge",
        "  tactibench check ridge",
        "  tactibench run exp1 --model ridge --quick",
    ]
    assert cli("new", "sensor", "box", "--out", "else/where")[0] == 0
    assert (tmp_path / "else" / "where" / "tactibench-box" / "README.md").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["model", "unet"], "taken by the model of plugin 'unet'"),
        (["model", "../ridge"], "is a path"),
        (["robot", "ridge"], "'robot' is not one of"),
    ],
)
def test_new_refuses_and_writes_nothing(
    refused: Any, tmp_path: Path, arguments: list[str], said: str
) -> None:
    assert said in refused("new", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_check_prints_a_line_a_property_and_the_counts(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli("check", "mean", "--json", "found.json")
    assert (code, err) == (0, "")
    first, *lines, last = out.splitlines()
    assert first.startswith("model mean of plugin 'baselines' (tactibench ")
    assert last == "14 ran: 13 passed, 0 failed, 1 failed as expected; 2 skipped"
    (expected,) = [line for line in lines if "failed as expected" in line]
    assert "nan_frame" in expected
    assert "looks at no frame" in expected
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert len(found["properties"]) == len(lines) == 16
    assert {one["outcome"] for one in found["properties"]} == {
        "passed",
        "failed as expected",
        "skipped",
    }


def test_check_ends_with_1_when_something_is_not_as_expected(cli: Any) -> None:
    code, out, _ = cli("check", "depth", "--expect-failed", "noise=reads cells")
    assert code == 1
    assert "1 passed unexpectedly" in out.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["unett"], "did you mean 'unet'?"),
        (["mean", "--expect-failed", "nan_frame"], "write PROPERTY=REASON"),
        (["mean", "--kind", "sensor"], "unknown sensor 'mean'"),
        (["nearest", "--sensor", "recorded"], "presses only the scenes that it has"),
        (["recorded"], "--data DIR"),
    ],
)
def test_check_refuses(refused: Any, arguments: list[str], said: str) -> None:
    assert said in refused("check", *arguments)
