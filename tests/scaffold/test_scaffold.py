"""Packages that ``tactibench new`` writes, and names that it refuses."""

from __future__ import annotations

import ast
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.plugins import KINDS, Origin, PluginHost
from tactibench.scaffold import Names, check_name, render_templates, write_package

HOST = PluginHost()


TEMPLATES = [
    *((kind, "") for kind in KINDS),
    ("sensor", "skin"),
    ("model", "torch"),
]
each_template = pytest.mark.parametrize(("kind", "template"), TEMPLATES)


@each_template
def test_every_file_is_whole(kind: str, template: str) -> None:
    files = render_templates(Names(kind, "two_words"), template)
    assert set(files) == {
        "README.md",
        "pyproject.toml",
        "tactibench_two_words/__init__.py",
        "tactibench_two_words/hooks.py",
        f"tactibench_two_words/{kind}.py",
        "tests/test_conformance.py",
    }
    for name, text in files.items():
        assert "$" not in text
        assert text.endswith("\n")
        assert "two_words" in text
        if name.endswith(".py"):
            ast.parse(text)
            assert max(map(len, text.splitlines())) <= 100
    base = "LearnedModel" if template == "torch" else kind.title()
    assert f"class TwoWords({base}):" in files[f"tactibench_two_words/{kind}.py"]
    project = tomllib.loads(files["pyproject.toml"])["project"]
    assert project["name"] == "tactibench-two-words"
    assert project["entry-points"]["tactibench"] == {"two_words": "tactibench_two_words.hooks"}


@each_template
def test_the_host_takes_what_is_written(
    kind: str, template: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"hosted_{template or kind}"
    folder = write_package(Names(kind, name), tmp_path / "not" / "there", template)
    assert folder == tmp_path / "not" / "there" / f"tactibench-{name.replace('_', '-')}"
    monkeypatch.syspath_prepend(str(folder))
    point = EntryPoint("it", f"tactibench_{name}.hooks", "tactibench")
    host = PluginHost([(point, Origin("it", "dist", "1"))])
    assert host.problems == ()
    catalogue = host.catalogue(kind)
    (spec,) = catalogue
    assert spec.name == name
    assert spec.load().__name__ == f"Hosted{(template or kind).capitalize()}"


@each_template
def test_hooks_import_nothing_heavy(kind: str, template: str) -> None:
    files = render_templates(Names(kind, "light"), template)
    tree = ast.parse(files["tactibench_light/hooks.py"])
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules == {"__future__", "tactibench"}
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Import)]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("a/b", "is a path"),
        ("..", "no identifier"),
        ("my-net", "no identifier"),
        ("", "no identifier"),
        ("réseau", "no identifier"),
        ("x\n", "no identifier"),
        ("class", "keyword"),
        ("Ridge", "no identifier"),
        ("_mine", "no identifier"),
        ("mine_", "no identifier"),
        ("m" * 41, "longer than 40"),
        ("unet", "taken by the model of plugin 'unet'"),
        ("sim", "taken by plugin 'sim'"),
    ],
)
def test_names_that_cannot_be_taken(name: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        check_name("model", name, HOST)


def test_a_name_that_another_kind_has_can_be_taken() -> None:
    assert check_name("model", "hertz", HOST).package == "tactibench_hertz"
    with pytest.raises(UserError, match="the encoder of plugin 'heatmaps'"):
        check_name("encoder", "hertz", HOST)


def test_an_importable_package_keeps_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tactibench_there").mkdir()
    (tmp_path / "tactibench_there" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UserError, match="the installed package 'tactibench_there'"):
        check_name("sensor", "there", HOST)


@pytest.mark.parametrize("kind", ["folder", "file", "dangling link"])
def test_what_is_there_is_left_as_it_is(tmp_path: Path, kind: str) -> None:
    there = tmp_path / "tactibench-ridge"
    if kind == "folder":
        there.mkdir()
    elif kind == "file":
        there.write_text("mine")
    else:
        there.symlink_to(tmp_path / "nowhere")
    with pytest.raises(UserError, match="is there already"):
        write_package(Names("model", "ridge"), tmp_path)
    assert list(tmp_path.iterdir()) == [there]


def test_a_file_is_no_place(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(UserError, match="is not a folder"):
        write_package(Names("model", "ridge"), tmp_path / "file")
