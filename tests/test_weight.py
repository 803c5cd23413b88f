"""No package outgrows its ceiling: see docs/decisions/code.md before one is raised."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "weight.py"


@pytest.fixture(scope="module")
def weight() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


def test_no_package_has_more_code_or_modules_than_its_ceiling(weight: dict[str, Any]) -> None:
    ceilings = weight["CEILINGS"]
    found = weight["weights"]()
    over = {
        name: (here, ceilings.get(name))
        for name, here in found.items()
        if name not in ceilings
        or any(n > most for n, most in zip(here, ceilings[name], strict=True))
    }
    assert over == {}, "remove something, or raise CEILINGS with a line in docs/decisions/code.md"
    assert set(ceilings) == set(found)


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("", 0),
        ('"""A docstring."""\n\n# a comment\n', 0),
        ("import os\n\n\nX = (\n    1,\n    # why\n    2,\n)\n", 5),
        ('def f() -> str:\n    """Return a text.\n\n    More.\n    """\n    return "a"\n', 2),
        ('class A:\n    """A class."""\n\n    x: int\n    """An attribute."""\n', 3),
        ('TEXT = """\nline\n"""\n', 3),
    ],
)
def test_only_lines_that_hold_code_count(weight: dict[str, Any], text: str, lines: int) -> None:
    assert weight["code_lines"](text) == lines
