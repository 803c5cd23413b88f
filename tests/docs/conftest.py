"""The example plugin as an installed package."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_distribution import fake_distribution

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "tactile_pocket"


@pytest.fixture
def pocket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The example plugin as a distribution on the path; forgotten afterwards."""
    site = tmp_path / "site"
    shutil.copytree(EXAMPLE, site / EXAMPLE.name, ignore=shutil.ignore_patterns("__pycache__"))
    fake_distribution(site, "tactile-pocket", pocket=f"{EXAMPLE.name}.hooks")
    monkeypatch.syspath_prepend(str(site))
    yield site
    for name in [name for name in sys.modules if name.partition(".")[0] == EXAMPLE.name]:
        del sys.modules[name]
