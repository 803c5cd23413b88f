"""The command in this process, as far as it needs no other one."""

from __future__ import annotations

import builtins
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def test_a_dry_run_lists_and_writes_nothing(
    cli: Any, asked: Callable[[str], Path], tmp_path: Path
) -> None:
    text = """
        model = ["toy", "toy-single"]
        regime = ["single", "multiple"]
    """
    file = asked(text)
    before = {path for path in tmp_path.rglob("*") if "__pycache__" not in path.parts}
    code, out, err = cli("sweep", file, "--dry-run", "--json", "rows.json")
    assert (code, err) == (1, ""), "a cell that cannot be run is told beforehand"
    assert "8 cells: 6 to do, 2 failed" in out
    assert out.count("toy-single multiple toy seed 0: model 'toy-single' predicts one") == 2
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [row["metric"] for row in rows] == ["failed", "failed"]
    assert {row["unit"] for row in rows} == {""}
    assert rows[0]["why"].startswith("model 'toy-single' predicts one contact")
    after = {path for path in tmp_path.rglob("*") if "__pycache__" not in path.parts}
    assert after - before == {tmp_path / "rows.json"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("none.toml",), "sweep file none.toml cannot be read"),
        (("FILE", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"), "leave them out"),
        (("FILE", "--json", "no/where.json"), "the folder no is not there"),
    ],
)
def test_mistakes(
    refused: Any, asked: Callable[[str], Path], arguments: tuple[str, ...], says: str
) -> None:
    file = str(asked('model = "toy"'))
    assert says in refused("sweep", *(file if word == "FILE" else word for word in arguments))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x"])
def test_a_scheduler_that_does_not_answer(
    refused: Any,
    asked: Callable[[str], Path],
    tmp_path: Path,
    address: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("distributed", reason="the engine of sweeps is an extra of its own")
    monkeypatch.setattr("tactibench.sweep.cluster.PATIENCE_S", 0.2)
    sentence = refused("sweep", asked('model = "toy"'), "--scheduler", address)
    assert f"no scheduler answers at --scheduler {address} (" in sentence
    assert not (tmp_path / "runs").exists()
    assert not (tmp_path / "cache").exists()


def test_without_dask_a_sentence_says_what_to_install(
    refused: Any, asked: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    whole = builtins.__import__

    def without(name: str, *more: Any, **others: Any) -> Any:
        if name in ("dask", "distributed"):
            raise ImportError(name)
        return whole(name, *more, **others)

    monkeypatch.setattr(builtins, "__import__", without)
    assert "pip install 'tactibench[sweep]'" in refused("sweep", asked('model = "toy"'))
    assert not (tmp_path / "runs").exists()
