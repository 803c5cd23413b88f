"""Runs that cannot be scored again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tactibench.cli.main import call
from tactibench.records import with_checksum

pytestmark = pytest.mark.long
QUICK = ("run", "exp1", "--model", "mean", "--quick", "--device", "cpu")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one stored run."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("TACTIBENCH_CACHE", str(folder / "cache"))
        code = call([*QUICK, "--presses", "40", "--limit", "12", "--param", "sensor.size=64"])
    assert code == 0
    (run,) = (path.parent for path in (folder / "runs").glob("*/record.json"))
    return run


@pytest.fixture
def stored(finished: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(finished, tmp_path / "runs" / finished.name))


def rewrite(run: Path, **keys: Any) -> None:
    file = run / "record.json"
    record = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(with_checksum({**record, **keys})), encoding="utf-8")


def test_a_whole_run_is_scored_the_same(cli: Any, stored: Path, tmp_path: Path) -> None:
    code, out, err = cli("score", stored.name, "--json", "again.json")
    assert (code, err) == (0, "")
    assert "rows are identical to the stored ones" in out
    again = json.loads((tmp_path / "again.json").read_text(encoding="utf-8"))
    assert again == json.loads((stored / "record.json").read_text(encoding="utf-8"))


def test_changed_numbers_are_told_and_exit_with_1(cli: Any, stored: Path) -> None:
    record = json.loads((stored / "record.json").read_text(encoding="utf-8"))
    row = next(row for row in record["metrics"] if row["metric"] == "spurious")
    row |= {"value": 0.5, "low": 0.4, "high": 0.6}
    rewrite(stored, metrics=record["metrics"])
    code, out, _ = cli("score", stored.name)
    assert code == 1
    assert "spurious of all: stored" in out


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"schema": 1}', "\xff", "NaN"])
def test_a_damaged_record(refused: Any, stored: Path, text: str) -> None:
    (stored / "record.json").write_bytes(text.encode("latin-1"))
    assert "record.json" in refused("score", stored.name)


@pytest.mark.parametrize("part", ["truth", "predictions", "maps"])
def test_damaged_arrays(refused: Any, stored: Path, part: str) -> None:
    file = stored / f"{part}.npz"
    file.write_bytes(file.read_bytes()[:-30])
    assert f"{part}.npz" in refused("score", stored.name)
    file.unlink()
    assert f"{part}.npz does not exist" in refused("score", stored.name)
