"""Spoilt files: a sentence or success, in time and in memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fuzzed import TARGETS, attempt, inputs
from hypothesis import given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.long

FEW, MANY, LIMIT_S = 40, 20_000, 600.0
SLOWEST_S, MOST_BYTES = 2.0, 2**30
TAKEN = Path("/proc/self/statm")
"""Pages of this process, where the system tells."""


@contextmanager
def room(most: int) -> Iterator[None]:
    """So many bytes beside those that are taken now and no more, for all inputs together: who asks
    for them gets a MemoryError. As much as there is where the system does not tell."""
    if not TAKEN.is_file():
        yield
        return
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(TAKEN.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_spoilt_is_right_before(name: str, tmp_path: Path) -> None:
    """Or else everything would be refused at the first key, and nothing tried."""
    target = TARGETS[name]
    assert any(attempt(target, seed, tmp_path) for seed in target.seeds(tmp_path))


@pytest.mark.filterwarnings(
    "default"
)  # of numpy, about what was asked of it; no warning is an error
@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_spoilt_input_gets_a_sentence(name: str, count: int, tmp_path: Path) -> None:
    if name == "hardware":
        pytest.importorskip("tactibench_tactip")
    target, began, refused = TARGETS[name], time.monotonic(), 0
    for data in target.seeds(tmp_path)[:1]:
        attempt(target, data, tmp_path)  # imports and compiles
    with room(MOST_BYTES):
        for number, data in enumerate(inputs(target, tmp_path, 7, count)):
            start = time.process_time()
            try:
                refused += not attempt(target, data, tmp_path)
            except Exception as error:
                error.add_note(f"input {number} of {name}: {data[:2000]!r}")
                raise
            assert time.process_time() - start < SLOWEST_S, (number, data[:2000])
            assert time.monotonic() - began < LIMIT_S, f"only {number} inputs in {LIMIT_S:g} s"
    assert refused > 0


@pytest.mark.parametrize("name", sorted(set(TARGETS) - {"hardware"}))
def test_any_bytes_get_a_sentence(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp(name)

    @settings(max_examples=15)
    @given(st.binary(max_size=400) | st.text(max_size=200).map(lambda text: text.encode()))
    def check(data: bytes) -> None:
        attempt(TARGETS[name], data, folder)

    check()
