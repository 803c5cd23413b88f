"""Nobody ever reads half a file."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tactibench import Contacts, PlatePose, UserError
from tactibench.records import (
    MANIFEST,
    CacheEntry,
    arrays_hash,
    atomic,
    pack,
    read_arrays,
    read_checked_json,
    read_json,
    unpack_contacts,
    unpack_plates,
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


def test_a_reader_sees_the_old_file_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "far" / "below" / "file"
    with atomic(path) as stream:
        stream.write(b"one")
    with atomic(path) as stream:
        stream.write(b"two")
        assert path.read_bytes() == b"one"
    assert path.read_bytes() == b"two"


@pytest.mark.parametrize("content", [None, b"{", b"\xff", b"[" * 100_000, b'{"a": 1, "a": 2}'])
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


@settings(max_examples=30)
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


FILES = {"a.npy": b"0123456789" * 9, "below/b.bin": b"x"}


def fill(folder: Path) -> dict[str, Any]:
    for name, content in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    return {"presses": 3}


@pytest.fixture
def entry(tmp_path: Path) -> CacheEntry:
    return CacheEntry(tmp_path / "cache" / "key", {"model": "mean", "seed": 0})


def test_what_was_written_is_read(entry: CacheEntry) -> None:
    assert (entry.cached, entry.read()) == (False, None)
    manifest = entry.write(fill)
    assert entry.cached
    assert entry.read() == manifest
    assert manifest["presses"] == 3
    assert set(manifest["files"]) == set(FILES)
    assert CacheEntry(entry.folder, {"seed": 0, "model": "mean"}).read() == manifest
    assert CacheEntry(entry.folder, {"seed": 1, "model": "mean"}).read() is None
    entry.remove()
    assert not entry.cached


@pytest.mark.parametrize("error", [OSError("full"), KeyboardInterrupt()])
def test_a_failed_write_leaves_what_was_there(entry: CacheEntry, error: BaseException) -> None:
    manifest = entry.write(fill)

    def fail(folder: Path) -> dict[str, Any]:
        fill(folder)
        raise error

    with pytest.raises(type(error)):
        entry.write(fail)
    assert entry.read() == manifest
    assert [path.name for path in entry.folder.parent.iterdir()] == [entry.folder.name]


def flip(path: Path) -> None:
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "flipped": flip,
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-5]),
    "gone": lambda path: path.unlink(),
    "an object": lambda path: path.write_text('{"files": {}}'),
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", [*FILES, MANIFEST])
def test_a_damaged_entry_is_not_read_and_can_be_replaced(
    entry: CacheEntry, name: str, damage: str
) -> None:
    manifest = entry.write(fill)
    DAMAGES[damage](entry.folder / name)
    assert entry.read() is None
    assert entry.write(fill) == manifest == entry.read()


FINITE = st.floats(-100, 100)


@st.composite
def contacts(draw: st.DrawFn) -> Contacts:
    n = draw(st.integers(0, 4))
    std = draw(st.none() | hnp.arrays(float, (n, 3), elements=st.floats(0, 9)))
    return Contacts(
        draw(hnp.arrays(float, (n, 2), elements=FINITE)),
        draw(hnp.arrays(float, n, elements=FINITE)),
        draw(hnp.arrays(float, n, elements=st.floats(0, 1))),
        std,
    )


@settings(max_examples=40)
@given(st.lists(contacts(), max_size=6))
def test_contacts_come_back(answers: list[Contacts]) -> None:
    again = unpack_contacts(pack(answers, "contacts"))
    assert len(again) == len(answers)
    for one, two in zip(answers, again, strict=True):
        for name in ("xy", "depth", "score"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        if one.std is None or not len(one):
            assert two.std is None
        else:
            np.testing.assert_array_equal(one.std, two.std)


PLATES = st.none() | st.builds(PlatePose, FINITE, FINITE, st.none() | st.tuples(FINITE, FINITE))


@given(st.lists(PLATES, max_size=6))
def test_plates_come_back(answers: list[PlatePose | None]) -> None:
    assert unpack_plates(pack(answers, "plate")) == tuple(answers)
