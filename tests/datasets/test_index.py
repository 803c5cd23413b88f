"""A journal that is opened by its index holds what a journal that is read line by line holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench.datasets import INDEX, JOURNAL, Draft, Header, Samples, Writer, open_dataset
from tactibench.datasets import index as index_module

COUNT = 12
HEADER = Header("set", {"name": "skin"}, signal=(3,))


def add(writer: Writer, *numbers: int) -> None:
    for number in numbers:
        signal = np.full(3, number, np.float32)
        status = "bad" if number == 2 else "ok"
        writer.add(Draft(signal, number, labels={"a": 0.5 * number}, status=status))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with Writer(tmp_path / "set", HEADER) as writer:
        add(writer, *reversed(range(COUNT)))
    return tmp_path / "set"


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four lines are enough for an index."""
    monkeypatch.setattr(index_module, "SHORTEST", 4)


def test_samples_by_index_are_those_of_the_lines(folder, short, monkeypatch) -> None:
    for _ in range(2):  # without an index, and by the one that was written then
        by_index = open_dataset(folder)
        assert isinstance(by_index.samples, Samples)
    assert (folder / INDEX).is_file()
    monkeypatch.setattr(index_module, "SHORTEST", 1000)
    whole = open_dataset(folder)
    assert by_index.samples == whole.samples
    assert by_index.samples[3:5] == whole.samples[3:5]
    assert by_index.samples[-1] == whole.samples[-1]
    assert by_index.sha256 == whole.sha256
    assert by_index.index.good.tolist() == [sample.status == "ok" for sample in whole.samples]
    for sample in whole.samples:
        np.testing.assert_array_equal(by_index.signal(sample), np.full(3, sample.id, np.float32))
    with pytest.raises(KeyError):
        by_index.index.row_of(COUNT)
    assert COUNT not in by_index.index
    assert 0 in by_index.index


def test_the_writer_leaves_an_index(tmp_path, short) -> None:
    with Writer(tmp_path / "set", HEADER) as writer:
        add(writer, *range(COUNT))
    assert (tmp_path / "set" / INDEX).is_file()
    assert len(open_dataset(tmp_path / "set").samples) == COUNT


def test_lines_behind_the_index_are_read(tmp_path, short) -> None:
    writer = Writer(tmp_path / "set", HEADER)
    add(writer, *range(6))
    assert len(open_dataset(tmp_path / "set").samples) == 6
    add(writer, 6, 7)
    assert [sample.id for sample in open_dataset(tmp_path / "set").samples] == list(range(8))
    with (tmp_path / "set" / JOURNAL).open("ab") as stream:
        stream.write(b'{"id": 8')
    assert open_dataset(tmp_path / "set", repair=False).index.torn == b'{"id": 8'
    writer.leave_open()


@pytest.mark.parametrize("damage", [b"", b"x" * 100, None])
def test_an_index_that_is_damaged_or_of_another_journal_is_made_again(
    folder, short, tmp_path, damage
) -> None:
    open_dataset(folder)
    path = folder / INDEX
    whole = path.read_bytes()
    if damage is None:
        with Writer(tmp_path / "other", HEADER) as writer:
            add(writer, *range(COUNT))
        path.write_bytes((tmp_path / "other" / INDEX).read_bytes())
    else:
        path.write_bytes(damage)
    assert [sample.id for sample in open_dataset(folder).samples] == list(reversed(range(COUNT)))
    assert path.read_bytes() == whole


def test_twins_and_a_changed_line_are_named(tmp_path, short) -> None:
    writer = Writer(tmp_path / "set", HEADER)
    add(writer, *range(6))
    writer.leave_open()
    path = tmp_path / "set" / JOURNAL
    dataset = open_dataset(tmp_path / "set")
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines, lines[1]]))
    with pytest.raises(UserError, match="lines 2 and 7 are both of id 1"):
        open_dataset(tmp_path / "set")
    path.write_bytes(b"".join([lines[1], lines[0], *lines[2:]]))
    with pytest.raises(UserError, match="line 1 was changed while it was in use"):
        dataset.samples[0]
