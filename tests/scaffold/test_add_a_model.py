"""docs/add-a-model.md, run as it stands, and plugins installed by pip as their authors would."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from surroundings import surroundings

from tactibench.plugins import KINDS
from tactibench.scaffold import Names, write_package
from tactibench.testing import properties

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "add-a-model.md"
PIP = "python -m pip install -q --no-deps --no-build-isolation --no-index --target ../site"
"""Without a network, and not into the environment of the tests."""


def shell_blocks() -> list[str]:
    return re.findall(r"^```sh\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"), re.M | re.S)


def ran(script: str, folder: Path) -> str:
    """Lines of a shell, stopped by the first that fails; what they print."""
    work = folder / "work"
    work.mkdir(exist_ok=True)
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=work,
        env=surroundings(folder, folder / "site", PYTHONWARNINGS=""),
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert done.returncode == 0, f"{script}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_the_table_names_every_property_of_a_model() -> None:
    table = DOCUMENT.read_text(encoding="utf-8").partition("| property |")[2].partition("\n\n")[0]
    named = re.findall(r"`(\w+)`", table)
    assert [one.name for one in properties("model")] == named


def test_what_the_document_links_to_is_there() -> None:
    links = re.findall(r"\]\((\w[^)#]*)\)", DOCUMENT.read_text(encoding="utf-8"))
    assert links
    for link in links:
        assert (DOCUMENT.parent / link).is_file()


@pytest.mark.slow
def test_every_shell_block_runs(tmp_path: Path) -> None:
    blocks = shell_blocks()
    assert len(blocks) == 5
    (tmp_path / "work").mkdir()
    shutil.copytree(ROOT / "leaderboards", tmp_path / "work" / "leaderboards")
    printed = [ran(block.replace("pip install -e", PIP), tmp_path) for block in blocks]
    assert "13 ran: 13 passed, 0 failed; 3 skipped" in printed[0]
    assert "PARTIAL (quick)" in printed[0]
    assert "13 passed, 3 skipped" in printed[1]
    assert "1,000 test presses" in printed[2]
    page = (tmp_path / "work" / "leaderboards" / "exp1.md").read_text(encoding="utf-8")
    assert "| ridge" in page
    assert (tmp_path / "work" / "frontier.png").stat().st_size > 10_000
    assert printed[4].count(", 0 failed;") == 2


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_an_installed_plugin_holds_its_own_tests(kind: str, tmp_path: Path) -> None:
    package = write_package(Names(kind, f"own_{kind}"), tmp_path)
    ran(f"{PIP} {package}", tmp_path)
    printed = ran(f"python -m pytest -q -W error {package}", tmp_path)
    counted = re.search(r"(\d+) passed, (\d+) skipped", printed)
    assert counted is not None
    assert int(counted[1]) + int(counted[2]) == len(properties(kind))
