"""``tactibench plot frontier`` and ``tactibench plot curve`` read what is committed."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from tactibench import api
from tactibench.board import compact
from tactibench.cli.plot import plot
from tactibench.records import text_of

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def board(tmp_path, fabricate):
    """A folder of boards with a few committed records."""
    folder = tmp_path / "leaderboards" / "submissions" / "exp1"
    folder.mkdir(parents=True)
    whole = [
        fabricate(settings={"width": w}, error=e, p90_ms=p)
        for w, e, p in ((8, 0.05, 2.0), (16, 0.10, 3.0), (32, 0.03, 9.0))
    ]
    others = [
        fabricate(settings={"width": 8}, sensor={"instance": 1}),
        fabricate(model="cnn", encoder=None, machine="ba9876543210"),
        fabricate(settings={"width": 8}, error=0.2, limits={"presses": 250}, data={"train": 250}),
    ]
    for record in map(compact, [*whole, *others]):
        (folder / f"{record.name}.json").write_text(text_of(record))


def test_the_frontier_names_who_is_dominated_and_by_whom(cli, board):
    code, out, err = cli("plot", "frontier", "exp1", "--out", "f.png", "--json", "f.json")
    assert (code, err) == (0, "")
    lines = {line.split("  ")[0]: line for line in out.split("\n")}
    assert "dominated by unet, width=8" in lines["unet, width=16"]
    assert lines["unet, width=32"].rstrip().endswith("frontier")
    assert "Left out: 1 run timed on another machine than 0123456789ab." in out
    assert "Left out: 1 run on other sensors." in out
    assert Path("f.png").read_bytes().startswith(PNG)
    rows = json.loads(Path("f.json").read_text())
    assert {row["metric"] for row in rows} == {"p90_ms", "gospa_depth_mm"}
    (beaten,) = [r for r in rows if r["dominated_by"] and r["metric"] == "gospa_depth_mm"]
    assert (beaten["group"], beaten["value"]) == ("unet, width=16", 0.1)


def test_the_curve_is_of_what_was_run_with_several_numbers_of_presses(cli, board):
    assert "cnn" in cli("plot", "frontier", "exp1", "--machine", "ba9876543210")[1]
    code, out, _ = cli("plot", "curve", "exp1", "--json", "c.json")
    assert code == 0
    assert "0.2000 [0.1800, 0.2200]" in out
    assert "cnn" not in out
    rows = json.loads(Path("c.json").read_text())
    assert [(row["presses"], row["value"]) for row in rows] == [(250, 0.2), (3600, 0.05)]


def test_a_curve_shows_the_best_six_and_says_so(cli, board, fabricate):
    for k in range(7):
        for few in ({}, {"limits": {"presses": 250}, "data": {"train": 250}}):
            record = compact(fabricate(settings={"width": 90 + k}, error=0.05 - k / 200, **few))
            Path(f"leaderboards/submissions/exp1/{record.name}.json").write_text(text_of(record))
    code, out, _ = cli("plot", "curve", "exp1", "--json", "c.json")
    assert code == 0
    assert out.endswith("The picture shows the first 6 rows.\n")
    groups = list(dict.fromkeys(row["group"] for row in json.loads(Path("c.json").read_text())))
    assert [name.partition("width=")[2][:2] for name in groups][:4] == ["96", "95", "94", "93"]
    made = api.plot("curve", "exp1", board="leaderboards").data.draw()
    assert [text.get_text() for text in made.legends[0].get_texts()] == groups[:6]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plot", "frontier", "exp9"], "unknown protocol 'exp9'; did you mean"),
        (["plot", "frontier", "exp2"], "there is no complete run of exp2"),
        (["plot", "frontier", "exp1", "--machine", "x"], "no run was timed on a machine 'x'"),
        (["plot", "frontier", "exp1", "--sensor", "tactip-128"], "did you mean 'tactip-127"),
        (["plot", "frontier", "exp1", "--out", "f.pdf"], "f.pdf is no PNG file; call it f.png"),
        (["plot", "frontier", "exp1", "--out", "no/f.png"], "the folder no is not there"),
        (["plot", "frontier", "exp1", "--board", "leaderbord"], "did you mean 'leaderboards'?"),
        (
            ["plot", "frontier", "exp1", "--board", "no"],
            "there is no folder no; name another with --board DIR, or leave it out.",
        ),
        (
            ["plot", "curve", "exp1", "--new-sensor"],
            "exp1 --model MODEL --test sensor.instance=1",
        ),
        (["plot", "curve", "exp2"], "there is no complete run of exp2"),
        (
            ["plot", "curve", "exp1", "--sensor", "tactip-127, instance=1"],
            "--model MODEL --presses N",
        ),
    ],
)
def test_mistakes(refused, board, arguments, words):
    assert words in refused(*arguments)


BOARDS = Path(__file__).parents[2] / "leaderboards"


def examples():
    """Lines of help texts that draw something from a board alone."""
    lines = "\n".join(str(verb.help) for verb in (plot, *plot.commands.values())).splitlines()
    found = [line.strip().partition("  ")[0] for line in lines if "--store" not in line]
    return [one for one in found if one.startswith("tactibench plot") and " limit" not in one]


@pytest.mark.long
@pytest.mark.parametrize("example", examples())
def test_an_example_draws_the_committed_rows(cli, example):
    Path("docs/images").mkdir(parents=True)
    words = shlex.split(example)[1:]
    code, out, err = cli(*words, "--board", BOARDS)
    assert (code, err) == (0, "")
    pictures = [word for word in words if word.endswith(".png")]
    assert all(f"picture: {picture}" in out for picture in pictures)
    assert all(Path(picture).read_bytes().startswith(PNG) for picture in pictures)
