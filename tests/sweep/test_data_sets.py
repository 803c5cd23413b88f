"""Data sets pressed in shards: the files are those of one process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from folder_files import CLOCKED, files

from tactibench.datasets import generate, verify
from tactibench.datasets import generation as press
from tactibench.errors import UserError
from tactibench.sweep import (
    DatasetTask,
    WorkerLossError,
    list_data_sets,
    press_data_set,
    read_sweep,
)

ASKED = """
    [[generate]]
    out = "shards"
    protocol = "protocols/few-exp3.toml"
    sensor = "toy"
"""


class Elsewhere:
    """An engine whose workers see only what can be pickled; fails after so many shards."""

    def __init__(self, fail_after: int | None = None) -> None:
        self.done, self.fail_after = 0, fail_after

    def map_in_order(self, work: Any, items: Iterable[Any]) -> Iterator[Any]:
        for item in items:
            if self.done == self.fail_after:
                raise WorkerLossError
            self.done += 1
            task, given = pickle.loads(pickle.dumps((work, item)))  # noqa: S301
            yield pickle.loads(pickle.dumps(task(given)))  # noqa: S301


@pytest.fixture
def wanted(asked: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> DatasetTask:
    monkeypatch.setattr(press, "CHUNK", 7)
    (one,) = list_data_sets(read_sweep(asked(ASKED)))
    return one


def test_shards_are_the_data_set_of_one_process(wanted: DatasetTask, tmp_path: Path) -> None:
    told: list[int] = []
    engine: Any = Elsewhere()
    press_data_set(wanted, engine, told.append)
    generate(tmp_path / "whole", wanted.source, wanted.plan, lambda _: None)
    assert files(wanted.folder, without=CLOCKED) == files(tmp_path / "whole", without=CLOCKED)
    assert engine.done > 10
    assert sum(told) == wanted.samples > 70
    assert wanted.is_complete
    assert verify(wanted.folder) == []


@pytest.mark.parametrize("after", [0, 1, 5])
def test_what_dead_workers_left_is_gone_on_with(
    wanted: DatasetTask, tmp_path: Path, after: int
) -> None:
    died: Any = Elsewhere(fail_after=after)
    with pytest.raises(UserError, match=r"the workers that pressed shards died .* goes on\."):
        press_data_set(wanted, died, lambda _: None)
    assert not wanted.is_complete
    rest: Any = Elsewhere()
    press_data_set(wanted, rest, lambda _: None)
    generate(tmp_path / "whole", wanted.source, wanted.plan, lambda _: None)
    assert files(wanted.folder, without=CLOCKED) == files(tmp_path / "whole", without=CLOCKED)
    assert died.done == after


def test_a_worker_with_another_sensor_is_refused(wanted: DatasetTask) -> None:
    other = replace(wanted.source, identity={**wanted.source.identity, "code": "other"})
    engine: Any = Elsewhere()
    with pytest.raises(UserError, match="sensor 'toy' is not the one of this machine"):
        press_data_set(replace(wanted, source=other), engine, lambda _: None)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            '[[generate]]\nout = "../{0}/shards"\nsensor = "toy"\n'
            'protocol = "protocols/few-exp1.toml"',
            "again",
        ),
        ('[[generate]]\nout = "b"', r"\[\[generate\]\] 2: name what is to be pressed"),
        ('[[generate]]\nout = "b"\nprotocol = "exp8"', "unknown protocol 'exp8'"),
        ('[[generate]]\nout = "b"\nplan = "no.jsonl"\nsensor = "toy"', "no.jsonl is no file"),
        ('[[generate]]\nout = "b"\nprotocol = "exp1"\nsensor = "recorded"', "data import"),
        (
            '[[generate]]\nout = "b"\nprotocol = "exp1"\nsensor = "toy"\nparams = ["model.a=1"]',
            "only the sensor has parameters",
        ),
    ],
)
def test_mistakes(asked: Callable[[str], Path], tmp_path: Path, more: str, says: str) -> None:
    from textwrap import dedent

    file = asked(dedent(ASKED) + more.format(tmp_path.name))
    with pytest.raises(UserError, match=says) as caught:
        list_data_sets(read_sweep(file))
    assert str(caught.value).startswith("sweep file ")
