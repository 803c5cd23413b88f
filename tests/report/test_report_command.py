"""``tactibench report``: what it writes, and what it says about mistakes."""

from __future__ import annotations

import re
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


def test_a_site_has_an_index_a_page_a_protocol_and_a_link_a_row(cli, made_store, tmp_path):
    code, out, err = cli("report", "--store", made_store, "--site", "public/boards")
    assert (code, err) == (0, "")
    folder = tmp_path / "public" / "boards"
    assert "index.html: 3 pages" in out
    assert {path.name for path in folder.iterdir()} >= {"index.html", "exp1.html", "exp2.html"}
    index = (folder / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([a-z0-9-]+\.html)#([a-z0-9-]+)"', index)
    assert links
    for file, anchor in links:
        assert f'<tr id="{anchor}">' in (folder / file).read_text(encoding="utf-8")
    assert 'id="exp2"' not in (folder / "exp1.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "page.html", "--site", "public"), "--out names one file and --site a folder"),
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
