"""Nobody ever reads half a file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tactibench import UserError
from tactibench.records import (
    arrays_hash,
    atomic,
    parse_json,
    read_arrays,
    read_checked_json,
    read_json,
    write_arrays,
    write_checked_json,
    write_json,
)


@pytest.mark.parametrize("before", [None, b"old"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), KeyboardInterrupt()])
def test_a_failed_write_changes_nothing(
    tmp_path: Path, before: bytes | None, error: BaseException
) -> None:
    path = tmp_path / "file"
    if before:
        path.write_bytes(before)

    def write() -> None:
        with atomic(path) as stream:
            stream.write(b"half")
            raise error

    with pytest.raises(type(error)):
        write()
    assert [p.name for p in tmp_path.iterdir()] == (["file"] if before else [])
    assert before is None or path.read_bytes() == before


def test_a_disk_that_fills_up_while_flushing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    for write in (
        lambda: write_json(tmp_path / "a.json", {"a": 1}),
        lambda: write_arrays(tmp_path / "a.npz", {"a": np.zeros(3)}),
    ):
        with pytest.raises(OSError, match="No space left"):
            write()
    assert not list(tmp_path.iterdir())


def test_a_reader_sees_the_old_file_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "below" / "file"
    with atomic(path) as stream:
        stream.write(b"one")
    with atomic(path) as stream:
        stream.write(b"two")
        assert path.read_bytes() == b"one"
    assert path.read_bytes() == b"two"


def test_nan_has_no_meaning_in_json(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [None, b"", b"{", b"\xff", b"[" * 100_000])
def test_unreadable_json(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=r"a\.json"):
        read_json(path)


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04", b"\x93NUMPY", b"x" * 99])
def test_unreadable_arrays(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=r"a\.npz"):
        read_arrays(path)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(UserError, match="damaged"):
        read_arrays(tmp_path / "a.npz")


TYPES = st.sampled_from(["u1", "i8", "f2", "f8", "?", "U3"])
ARRAYS = st.dictionaries(
    st.sampled_from("abc"),
    TYPES.flatmap(lambda t: hnp.arrays(t, hnp.array_shapes(min_dims=0, min_side=0, max_side=4))),
    max_size=3,
)


@given(ARRAYS)
def test_arrays_come_back(
    tmp_path_factory: pytest.TempPathFactory, arrays: dict[str, np.ndarray]
) -> None:
    path = tmp_path_factory.mktemp("arrays") / "a.npz"
    write_arrays(path, arrays)
    again = read_arrays(path)
    assert arrays_hash(again) == arrays_hash(arrays)
    assert {name: (a.dtype, a.shape) for name, a in again.items()} == {
        name: (a.dtype, a.shape) for name, a in arrays.items()
    }


def test_the_hash_sees_names_types_shapes_and_values() -> None:
    base = np.arange(6, dtype=np.int64)
    variants = [
        {"a": base},
        {"b": base},
        {"a": base.reshape(2, 3)},
        {"a": base.astype(np.int32)},
        {"a": base.view(np.float64)},
        {"a": base + 1},
        {"a": base, "b": base[:0]},
        {},
    ]
    assert len({arrays_hash(v) for v in variants}) == len(variants)
    assert arrays_hash({"a": base, "b": base}) == arrays_hash({"b": base, "a": base})
    assert arrays_hash({"a": base[::2]}) == arrays_hash({"a": base[::2].copy()})


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity", "1e999", "-1e400"])
def test_a_number_that_is_not_finite_is_refused(tmp_path: Path, word: str) -> None:
    """Python's own reader takes them all, and 1e999 for infinity."""
    path = tmp_path / "values.json"
    path.write_text(f'{{"value": [1.5, {word}]}}')
    with pytest.raises(UserError, match=f"holds {word}, which is no finite number"):
        read_json(path)


def test_what_is_no_plain_file_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with atomic(pipe) as stream:
        stream.write(b"whole")
    assert os.read(reader, 100) == b"whole"
    os.close(reader)
    assert pipe.is_fifo()


@pytest.mark.parametrize("text", ['{"a": 1, "a": 2}', '{"b": {"a": 1, "a": 1}}', "[1e999]", "NaN"])
def test_json_that_two_readers_would_read_differently_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="it holds"):
        parse_json(text)


def test_a_checked_object_comes_back_and_a_changed_one_does_not(tmp_path: Path) -> None:
    path = tmp_path / "it.json"
    write_checked_json(path, {"a": 1.5, "b": ["x"]})
    assert read_checked_json(path) == {"a": 1.5, "b": ["x"]}
    path.write_text(path.read_text().replace("1.5", "1.6"))
    with pytest.raises(UserError, match="is not what was written"):
        read_checked_json(path)
    write_json(path, {"a": 1.6})  # without a checksum
    with pytest.raises(UserError, match="is not what was written"):
        read_checked_json(path)
