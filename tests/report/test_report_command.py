"""``tactibench report``: what it writes, and what it says about mistakes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tactibench.cli.main import call

pytest.importorskip("jinja2", reason="the HTML report needs tactibench[report]")


@pytest.fixture
def cli(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))

    def called(*arguments):
        capsys.readouterr()
        code = call([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return called


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
def test_mistakes_get_a_sentence_and_nothing_is_written(cli, tmp_path, arguments, words):
    code, out, err = cli("report", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert not any(path.suffix == ".html" for path in tmp_path.rglob("*"))


def test_a_missing_library_is_named(cli, made_store, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    code, _, err = cli("report", "--store", made_store)
    assert code == 2
    assert "needs jinja2, which is not installed; run `pip install 'tactibench[report]'`" in err


def test_the_verb_is_there_without_its_libraries():
    heavy = "{'numpy', 'torch', 'matplotlib', 'jinja2'}"
    code = f"import sys, tactibench.cli.report; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_assets_travel_with_the_package():
    from importlib.resources import files

    assets = files("tactibench.report.html") / "assets"
    assert {Path(a.name).name for a in assets.iterdir()} == {"page.css", "page.html.j2", "page.js"}
