"""Runs of a tiny model on a tiny sensor in this process, and bytes that flip."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tiny_lab import Lab, tiny_host

from tactibench.records import Record, StoredRun
from tactibench.run import (
    NullReporter,
    RunPlan,
    RunRequest,
    Speed,
    evaluation,
    execute,
    make_plan,
)


@pytest.fixture
def plan(tmp_path: Path) -> Callable[..., RunPlan]:
    """A new plan of the same run, on the cache of this test."""
    request = RunRequest(str(Lab(tmp_path / "lab", "few-").protocols / "few-exp1.toml"), "tiny")

    def planned(store: str = "runs") -> RunPlan:
        return make_plan(request, tiny_host(), tmp_path / "cache", store=tmp_path / store)

    return planned


@pytest.fixture
def run(plan: Callable[..., RunPlan], monkeypatch: pytest.MonkeyPatch) -> Callable[..., StoredRun]:
    """Carry the run out, untimed, into a store of that name; ``fresh`` as on the command line."""
    monkeypatch.setattr(evaluation, "time_model", lambda *_, **__: Speed())

    def executed(store: str = "runs", *, fresh: bool = False) -> StoredRun:
        return execute(plan(store), NullReporter(), fresh=fresh)

    return executed


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record]:
    """Cache, store and protocols of one undisturbed run, to be copied, and its record."""
    folder = tmp_path_factory.mktemp("first")
    protocol = Lab(folder / "lab", "few-").protocols / "few-exp1.toml"
    request = RunRequest(str(protocol), "tiny")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "time_model", lambda *_, **__: Speed())
        plan = make_plan(request, tiny_host(), folder / "cache", store=folder / "runs")
        made = execute(plan, NullReporter())
    return folder, made.record


@pytest.fixture
def copied(first: tuple[Path, Record], tmp_path: Path) -> Path:
    """A copy of the undisturbed run's folder: that of this test."""
    for name in ("cache", "runs", "lab"):
        shutil.copytree(first[0] / name, tmp_path / name)
    return tmp_path


def flip(path: Path, at: int) -> None:
    """Change one byte of a file."""
    data = bytearray(path.read_bytes())
    data[at] ^= 0x15
    path.write_bytes(data)


@pytest.fixture(name="flip")
def _flip() -> Callable[[Path, int], None]:
    return flip
