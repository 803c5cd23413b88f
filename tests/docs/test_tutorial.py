"""docs/tutorial.md, run as it stands in an empty folder; what it shows is what is printed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from documented import Block, alike, blocks, missing, steps
from surroundings import surroundings

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorial.md"


def printed(arguments: list[str], folder: Path) -> str:
    work = folder / "work"
    work.mkdir(exist_ok=True)
    done = subprocess.run(
        arguments,
        cwd=work,
        env=surroundings(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1800,
    )
    assert done.returncode == 0, f"{arguments[-1]}\n{done.stdout}"
    return done.stdout


def run_page(page: list[Block], folder: Path) -> int:
    """Run all blocks in order; how many there were. A text block is what the python block above
    it prints."""
    count, last = 0, ""
    for block in page:
        count += 1
        if block.language == "console":
            for step in steps(block.text):
                out = printed(["bash", "-euo", "pipefail", "-c", step.command], folder)
                assert missing(step.shown, out) is None, f"{step.command}\n{out}"
        elif block.language == "python":
            last = printed([sys.executable, "-c", block.text], folder)
        else:
            assert block.language == "text", f"a block of {block.language!r} is not run"
            assert missing(block.text.splitlines(), last) is None, last
    return count


def page() -> list[Block]:
    return blocks(PAGE.read_text(encoding="utf-8"))


@pytest.mark.long
def test_the_quick_blocks_run_and_print_what_is_shown(tmp_path: Path) -> None:
    assert run_page([block for block in page() if not block.slow], tmp_path) == 6


@pytest.mark.slow
def test_every_block_runs_and_prints_what_is_shown(tmp_path: Path) -> None:
    assert run_page(page(), tmp_path) == PAGE.read_text(encoding="utf-8").count("```") / 2


@pytest.mark.parametrize(
    ("shown", "line", "same"),
    [
        ("a  0.100 [0.2]", "a 0.101  [0.2]", True),
        ("a 0.100", "a 0.2", False),
        ("in 3 min", "in 19 min", True),
        ("1,000 presses", "1,001 presses", True),
        ("5 presses", "6 presses", False),
        ("run-1a2b3c4d", "run-9f8e7d6c", True),
        ("a b ...", "a b c d", True),
        ("a c ...", "a b c d", False),
        ("a b", "a b c", False),
    ],
)
def test_lines_are_compared_up_to_numbers(shown: str, line: str, same: bool) -> None:
    assert alike(shown, line) is same


def test_lines_are_looked_for_in_order() -> None:
    out = "one\n\ntwo\nthree\n"
    assert missing(["one", "two"], out) is None
    assert missing(["...", "two"], out) is None
    assert missing(["two"], out) == "two"
    assert missing(["...", "three", "one"], out) == "one"
    assert missing(["one", "...", "four"], out) == "four"
    assert missing(["three", "three"], "three\n") == "three"


def test_commands_and_what_is_shown_are_told_apart() -> None:
    (block,) = blocks("text\n<!-- slow -->\n```console\n$ a \\\n  b\nc\n$ d\n```\n")
    assert (block.language, block.slow) == ("console", True)
    assert [(s.command, s.shown) for s in steps(block.text)] == [("a \\\n  b", ("c",)), ("d", ())]
