"""The reference is made from the code by mkdocstrings: every name that it asks for exists."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from tactibench.metrics import all_metrics

REFERENCE = Path(__file__).resolve().parents[2] / "docs" / "reference"
ASKED = [
    (page.name, module, members)
    for page in sorted(REFERENCE.glob("*.md"))
    for module, members in re.findall(
        r"^::: (tactibench\S*)\n(?:    options:\n      members: \[(.*)\])?",
        page.read_text(encoding="utf-8"),
        re.M,
    )
]


@pytest.mark.parametrize(("page", "module", "members"), ASKED)
def test_what_a_page_shows_exists_and_says_what_it_is(page: str, module: str, members: str) -> None:
    shown = importlib.import_module(module)
    for name in filter(None, members.split(", ")):
        assert hasattr(shown, name), f"{page}: {module}.{name}"
    assert shown.__doc__


def test_every_metric_says_what_it_is() -> None:
    assert not [name for name, spec in all_metrics().items() if not spec.formula]
