"""docs/reference is what the code gives, complete, and made without anything heavy."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tactibench.cli.main import VERBS
from tactibench.errors import UserError
from tactibench.metrics import FAMILIES

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "docs" / "reference"
SCRIPT = ROOT / "scripts" / "make_reference.py"
HEAVY = ("torch", "cv2", "matplotlib", "pandas")


def headings(page: str, marks: str) -> list[str]:
    text = (REFERENCE / page).read_text(encoding="utf-8")
    return re.findall(rf"^{marks} (.+)$", text, re.M)


def test_the_pages_are_what_the_code_gives_and_nothing_heavy_was_imported() -> None:
    code = (
        "import sys, runpy\n"
        f"sys.argv = ['make_reference.py', '--check']\nsys.path.insert(0, {str(SCRIPT.parent)!r})\n"
        f"try: runpy.run_path({str(SCRIPT)!r}, run_name='__main__')\n"
        "except SystemExit as end:\n"
        f"    print('loaded:', *sorted({set(HEAVY)!r} & set(sys.modules)))\n"
        "    sys.exit(end.code)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].strip() == "loaded:"


def test_no_help_shows_the_mark_of_an_example() -> None:
    """Click keeps the lines below a backspace as they are; in a raw docstring it is a word."""
    assert "\\b" not in (REFERENCE / "cli.md").read_text(encoding="utf-8")


def test_a_stale_page_is_named_and_written_again(make_reference: Any, tmp_path: Path) -> None:
    from click.testing import CliRunner

    def ran(*more: str) -> Any:
        return CliRunner().invoke(make_reference.main, ["--out", str(tmp_path), *more])

    assert ran("--check").exit_code == 1
    assert list(tmp_path.iterdir()) == []
    assert ran().output.count(": written") == len(make_reference.PAGES)
    assert ran("--check").exit_code == 0
    (tmp_path / "cli.md").write_text("old")
    stale = ran("--check")
    assert stale.exit_code == 1
    assert "cli.md is not what the code gives; run `python scripts/make_" in stale.output
    assert ran().output == "cli.md: written\n"


def test_every_metric_that_a_record_can_hold_is_on_the_page_and_no_other(
    make_reference: Any,
) -> None:
    from reference import metrics_page

    from tactibench.protocols import protocol_files, read_protocol

    can_hold = {
        name
        for path in protocol_files().values()
        for name in read_protocol(path).spec.metrics.names
    }
    committed = {
        name
        for file in (ROOT / "leaderboards" / "submissions").rglob("*.json")
        for name in re.findall(r'\{"metric": "(\w+)"', file.read_text(encoding="utf-8"))
    }
    said = {name for names in metrics_page.shipped().values() for name in names}
    assert can_hold | committed <= said
    page = (REFERENCE / "metrics.md").read_text(encoding="utf-8")
    shipped, _, own = page.partition(f"## {metrics_page.OWN}")
    assert set(re.findall(r"^### (\w+)$", shipped, re.M)) == said
    assert set(re.findall(r"^### (\w+)$", own, re.M)) == set(FAMILIES) - said


def test_every_verb_has_a_section() -> None:
    sections = {name.removeprefix("tactibench ") for name in headings("cli.md", "##")}
    assert {*VERBS, "sim"} <= sections
    assert {"tactibench data import", "tactibench board verify"} <= set(headings("cli.md", "###"))


def test_other_installed_plugins_change_no_page(make_reference: Any, pocket: Path) -> None:
    assert "greet" not in make_reference.text_of("cli.md")


def test_a_key_without_a_sentence_and_one_too_many_are_refused(make_reference: Any) -> None:
    from reference.keys import Keys

    keys = Keys({"Draw": {"name": "its name", "gone": "what was"}})
    with pytest.raises(UserError, match=r"keys\.toml says nothing about Draw\.count; add a line"):
        keys.agree("Draw", ["name", "count"])
    with pytest.raises(UserError, match=r"speaks of Draw\.gone, which is gone; remove it"):
        keys.agree("Draw", ["name"])


def test_a_verb_that_does_not_load_is_refused_in_words(make_reference: Any) -> None:
    import click
    from reference.commands_page import _verb

    class Broken(click.Group):
        def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
            if cmd_name == "gone":
                return None
            raise ImportError("no module")

    with pytest.raises(UserError, match=r"verb 'late' does not load \(no module\); mend it first"):
        _verb(Broken(), "late")
    with pytest.raises(UserError, match="verb 'gone' is listed, but there is none"):
        _verb(Broken(), "gone")


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("``a_b`` and c_d", "`a_b` and c\\_d"),
        ("a < b > c [d] *e*", "a &lt; b > c \\[d\\] \\*e\\*"),
        ("a\n\n    code *x*\n\nb", "a\n\n```text\ncode *x*\n```\n\nb"),
        (
            "\b\ntactibench list\ntactibench doctor",
            "```console\n$ tactibench list\n$ tactibench doctor\n```",
        ),
    ],
)
def test_docstrings_become_markdown(make_reference: Any, said: str, shown: str) -> None:
    from reference.text import prose

    assert "\n".join(prose(said)) == shown


def test_signatures_are_shown_as_they_were_written(make_reference: Any) -> None:
    import ast

    from reference.source import outline, signature

    (function,) = ast.parse("def f(a: int, *, b: str = 'x') -> list[int]: return []").body
    assert isinstance(function, ast.FunctionDef)
    assert signature(function) == "def f(a: int, *, b: str='x') -> list[int]"
    (kind,) = ast.parse('class A(B):\n x: int = 1\n def f(self):\n  """Says."""').body
    assert isinstance(kind, ast.ClassDef)
    assert outline(kind) == "class A(B):\n    x: int = 1\n    # Says.\n    def f(self): ..."
