"""``tactibench report``: what it writes, and what it says about mistakes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("jinja2", reason="the HTML report needs tactibench[report]")


def test_one_file_is_written(cli, made_store, tmp_path):
    code, out, err = cli("report", "--store", made_store, "--protocol", "exp2")
    assert (code, err) == (0, "")
    assert out.startswith("Made from 2 runs stored in ")
    assert "report.html: " in out
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["report.html"]
    assert b'id="exp1"' not in (tmp_path / "report.html").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "page.pdf"), "page.pdf is no HTML file; call it page.html"),
        (("--out", "none/page.html"), "the folder none is not there"),
        (("--protocol", "exp22"), "unknown protocol 'exp22'; did you mean 'exp2'"),
        (("--from", "runs"), "there is no run store in runs"),
        (("--store", "rums"), "there is no run store in rums"),
        (("--from", "both"), "there is no run store in runs"),
        (("--from", "board"), "there is no board in leaderboards"),
        (("--from", "all"), "'auto', 'runs', 'board', 'both'"),
        ((), "there is no board in leaderboards"),
    ],
)
def test_mistakes_get_a_sentence_and_nothing_is_written(refused, tmp_path, arguments, words):
    assert words in refused("report", *arguments)
    assert not any(path.suffix == ".html" for path in tmp_path.rglob("*"))


def test_a_missing_library_is_named(refused, made_store, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    sentence = refused("report", "--store", made_store)
    assert "needs jinja2, which is not installed" in sentence
    assert "`pip install 'tactibench[report]'`" in sentence


def test_assets_travel_with_the_package():
    from importlib.resources import files

    assets = files("tactibench.report.html") / "assets"
    assert {Path(a.name).name for a in assets.iterdir()} == {"page.css", "page.html.j2", "page.js"}
