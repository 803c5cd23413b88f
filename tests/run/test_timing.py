"""Timing under a clock that only stages move, rows against closed forms, and the machine's load."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numba
import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info

from tactibench import Contacts, Frame, Model, Pose, UserError
from tactibench.run import (
    Clocks,
    Counters,
    LatencySample,
    Load,
    declared_stages,
    limited_threads,
    parse_stat,
    time_calls,
    time_model,
)
from tactibench.run import timing as module

FRAME = Frame(np.zeros((8, 8), np.uint8), 0.0, Pose())
STAT = """cpu  400 0 200 3000 40 0 0 60 10 0
cpu0 100 10 100 1500 20 5 5 60 10 0
cpu1 300 0 100 1500 20 0 0 0 0 0
cpu2 9999 0 0 0 0 0 0 0 0 0
intr 1 2 3
"""


class Clock:
    """Stands still until a stage says how long it takes; remembers the names of the called."""

    def __init__(self, share: float = 1.0) -> None:
        self.now = 100.0
        self.called: list[str] = []
        self.share = share
        self.foreign_s = self.stolen_s = 0.0

    @property
    def clocks(self) -> Clocks:
        """The clocks of a process that computes ``share`` of the time, on two processors."""
        return Clocks(lambda: self.now, lambda: self.share * self.now, self.counters)

    def counters(self) -> Counters:
        own = self.share * self.now
        return Counters(own + self.foreign_s, self.stolen_s, 2 * self.now, 2, own)

    def stage(self, seconds: Callable[[int], float] | float, name: str = "all") -> Any:
        """Return a stage that takes ``seconds(call number)`` and returns what it is given."""
        count = 0

        def run(value: Any) -> Any:
            nonlocal count
            self.now += seconds(count) if callable(seconds) else seconds
            count += 1
            self.called.append(name)
            return value

        return name, run


def timed(clock: Clock, *stages: Any, frames: Sequence[Any] = "a", **more: Any) -> LatencySample:
    """Return the times of one model."""
    settings = {"threads": 1, "clocks": clock.clocks, **more}
    return time_calls({"only": stages}, frames, **settings)["only"]


def test_phases_are_timed_apart() -> None:
    clock = Clock()
    sample = timed(clock, clock.stage(0.001, "preprocess"), clock.stage(0.004, "forward"))
    assert sample.phases == ("preprocess", "forward")
    np.testing.assert_allclose(sample.raw_ms, np.tile([1.0, 4.0], (300, 1)), rtol=1e-6)
    np.testing.assert_allclose(sample.total_ms, 5.0, rtol=1e-6)
    assert (sample.settled, sample.warmup_calls, sample.batch) == (True, 40, 1)
    cpu = {row["phase"]: row["cpu_ms"] for row in sample.rows("single")}
    assert cpu == pytest.approx({"preprocess": 1.0, "forward": 4.0, "total": 5.0})


def test_each_stage_gets_what_the_one_before_returned() -> None:
    seen: list[Any] = []
    stages = [("one", lambda frames: [f + 1 for f in frames]), ("two", seen.append)]
    timed(Clock(), *stages, frames=[10, 20, 30], calls=4, budget_s=0.0)
    assert seen == [[11], [21], [31], [11]]  # a budget already spent: no warm-up at all


@pytest.mark.parametrize(
    ("seconds", "settles", "calls"),
    [
        (lambda call: 2.0 if call < 20 else 1.0, True, 60),  # the third block agrees
        (lambda call: 0.981 ** (call // 20), True, 40),  # 1.9 % a block
        (lambda call: 0.979 ** (call // 20), False, 500),
        (lambda call: 9.0 if call == 25 else 1.0, True, 40),  # one slow call moves no median
    ],
)
def test_warm_up_ends_when_two_blocks_agree_within_two_percent(
    seconds: Callable[[int], float], settles: bool, calls: int
) -> None:
    clock = Clock()
    sample = timed(clock, clock.stage(seconds))
    assert (sample.warm, sample.quiet, sample.settled) == (settles, True, settles)
    assert sample.warmup_calls == calls


def test_a_budget_stops_but_leaves_a_block() -> None:
    clock = Clock()
    sample = timed(clock, clock.stage(1.0), budget_s=100.0)
    assert (sample.settled, len(sample.raw_ms)) == (True, 60)  # 40 of the 100 s warmed up
    sample = timed(clock, clock.stage(1.0), budget_s=30.0)
    assert (sample.settled, sample.warmup_calls, len(sample.raw_ms)) == (False, 20, 20)


def test_models_are_called_in_turns_after_their_warm_ups() -> None:
    clock, rounds = Clock(), []
    models = {"a": [clock.stage(0.001, "a")], "b": [clock.stage(0.003, "b")]}
    settings = {"threads": 1, "block": 2, "clocks": clock.clocks}
    found = time_calls(models, "xyz", calls=6, advance=rounds.append, **settings)
    assert "".join(clock.called) == "aaaa" + "bbbb" + "aabb" * 3
    assert rounds == [1, 1, 1]
    np.testing.assert_allclose(found["a"].total_ms, [1.0] * 6)
    np.testing.assert_allclose(found["b"].total_ms, [3.0] * 6)
    clock.called.clear()
    time_calls(models, "xyz", calls=8, budget_s=0.0, **settings)
    assert "".join(clock.called) == "aabb"


def test_batches_take_frames_in_turn() -> None:
    seen: dict[str, list[Any]] = {"a": [], "b": []}
    models = {name: [("all", lambda given, n=name: seen[n].append(tuple(given)))] for name in seen}
    found = time_calls(models, {"a": "abcde", "b": "xyz"}, 2, threads=2, calls=6, budget_s=0.0)
    assert [(s.batch, s.threads, len(s.raw_ms)) for s in found.values()] == [(2, 2, 6)] * 2
    assert {*seen["a"]} == {("a", "b"), ("c", "d"), ("e", "a")}
    assert {*seen["b"]} == {("x", "y"), ("z", "x")}


def test_the_collector_is_off_in_calls_and_restored() -> None:
    states: list[bool] = []

    def fail(value: Any) -> None:
        states.append(gc.isenabled())
        if len(states) > 50:
            raise RuntimeError("stop")

    before = gc.isenabled()
    with pytest.raises(RuntimeError, match="stop"):
        timed(Clock(), ("all", fail))
    assert gc.isenabled() is before
    assert not any(states)


def sample_of(raw: Any, phases: tuple[str, ...], warm: bool = True) -> LatencySample:
    return LatencySample(phases, raw, raw, warm, 40, 2, 4, Load())


def test_quantiles_of_a_ramp() -> None:
    """0, 1 .. 100 ms: the q quantile is 100 q, the mean 50 ms, 4 frames a call: 80 a second."""
    ramp = np.arange(101.0)
    raw = np.column_stack([0.25 * ramp, 0.75 * ramp])
    rows = sample_of(raw, ("forward", "decode")).rows("offline")
    assert [row["phase"] for row in rows] == ["forward", "decode", "total"]
    for row, share in zip(rows, (0.25, 0.75, 1.0), strict=True):
        for name, value in (("p50", 50), ("p90", 90), ("p99", 99), ("mean", 50)):
            assert row[f"{name}_ms"] == pytest.approx(value * share)
        assert row["per_s"] == pytest.approx(80)
        assert (row["scenario"], row["threads"], row["batch"]) == ("offline", 2, 4)
        assert row["settled"] is True
        assert {type(value) for value in row.values()} <= {str, int, float, bool, type(None)}


@pytest.mark.parametrize(
    ("threads", "share", "foreign_s", "stolen_s", "settled"),
    [
        (1, 1.0, 0.0, 0.0, True),
        (1, 0.91, 0.0, 0.0, True),
        (1, 0.89, 0.0, 0.0, False),
        (1, 1.09, 0.0, 0.0, True),
        (1, 1.2, 0.0, 0.0, False),
        (2, 1.0, 0.0, 0.0, True),
        (2, 1.9, 0.0, 0.0, True),
        (2, 1.9, 0.19, 0.0, True),
        (2, 1.9, 0.21, 0.0, False),
        (2, 1.9, 0.0, 0.21, False),
        (2, 1.9, 0.11, 0.11, False),
        (2, 0.8, 0.0, 0.0, False),
        (1, 1.0, 0.19, 0.0, True),
        (1, 1.0, 1.0, 0.0, False),  # a training on the other processor
        (1, 1.0, 0.0, 0.21, False),
    ],
)
def test_times_are_settled_where_others_took_little(
    threads: int, share: float, foreign_s: float, stolen_s: float, settled: bool
) -> None:
    """100 calls of 10 ms on two processors: 2 s, of which others may take 0.2."""
    clock = Clock(share)

    def disturbed(value: Any) -> Any:
        clock.now += 0.01
        clock.foreign_s += foreign_s / 100
        clock.stolen_s += stolen_s / 100
        return value

    sample = timed(clock, ("all", disturbed), threads=threads, calls=100)
    (row,) = [row for row in sample.rows("single") if row["phase"] == "total"]
    assert sample.settled is row["settled"] is settled
    assert row["cpu_ms"] == pytest.approx(10 * share)
    assert row["foreign"] == pytest.approx(foreign_s / 2, abs=1e-9)
    assert row["stolen"] == pytest.approx(stolen_s / 2, abs=1e-9)


# The load of the machine ----------------------------------------------------------------------


def test_only_the_processors_of_this_process_count() -> None:
    found = parse_stat(STAT, {0, 1}, 1.5, 0.01)
    assert found == Counters(pytest.approx(6.2), pytest.approx(0.6), pytest.approx(37.2), 2, 1.5)
    assert parse_stat(STAT, {7}, 0.0, 0.01) is None
    assert parse_stat("", {0}, 0.0, 0.01) is None
    old_kernel = parse_stat("cpu0 100 0 100 800", {0}, 0.0, 0.01)
    assert old_kernel == Counters(2.0, 0.0, 10.0, 1, 0.0)


@pytest.mark.parametrize(
    ("before", "after", "foreign", "stolen", "quiet"),
    [
        # 3 s were computed, 2 of them by this process
        (Counters(10.0, 1.0, 100.0, 2, 5.0), Counters(13.0, 1.4, 104.0, 2, 7.0), 0.25, 0.1, False),
        # rounding of ticks is no negative load
        (Counters(10.0, 1.0, 100.0, 1, 5.0), Counters(10.99, 1.0, 101.0, 1, 6.0), 0.0, 0.0, True),
        (None, Counters(0, 0, 9, 1, 0), None, None, None),
        (Counters(0, 0, 9, 1, 0), None, None, None, None),
        (Counters(0, 0, 0, 2, 0), Counters(0, 0, 0.39, 2, 0), None, None, None),
        (Counters(0, 0, 0, 1, 0), Counters(0, 0, 9, 2, 0), None, None, None),
    ],
)
def test_shares_between_two_moments(
    before: Any, after: Any, foreign: Any, stolen: Any, quiet: Any
) -> None:
    found = Load.between(before, after)
    assert (found.foreign, found.stolen) == (pytest.approx(foreign), pytest.approx(stolen))
    assert found.quiet is quiet


# Threads --------------------------------------------------------------------------------------


def thread_counts() -> dict[str, int]:
    pools = {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}
    own = {"torch": torch.get_num_threads(), "cv2": cv2.getNumThreads()}
    return {**pools, **own, "numba": numba.get_num_threads()}


def test_torch_blas_opencv_and_numba_compute_with_as_many_threads() -> None:
    thread_counts()  # numba starts its threads when it is asked for the first time
    torch.set_num_threads(2)
    before = thread_counts()
    with limited_threads(1):
        assert set(thread_counts().values()) == {1}
    assert thread_counts() == before
    most = numba.config.NUMBA_NUM_THREADS
    with limited_threads(most + 1):
        assert (torch.get_num_threads(), numba.get_num_threads()) == (most + 1, most)


def test_threads_are_restored_where_the_model_changed_them_or_failed() -> None:
    before = thread_counts()
    with limited_threads(1):
        torch.set_num_threads(3)
    assert thread_counts() == before
    with pytest.raises(RuntimeError, match="inside"), limited_threads(1):
        raise RuntimeError("inside")
    assert thread_counts() == before


# Models ---------------------------------------------------------------------------------------


class Timed(Model):
    """Answers nothing, in the stages that a test gives it."""

    given: Any = None
    fit = save = load = None  # type: ignore[assignment]

    def predict(self, frames: Any) -> list[Contacts]:
        return [Contacts.none()] * len(frames)

    def stages(self) -> Any:
        return super().stages() if self.given is None else self.given


Timed.__abstractmethods__ = frozenset()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "stages",
    [7, [], [("a", 7)], [("a",)], [("a", list), ("a", list)], [("total", list)], [("a", len)]],
)
def test_wrong_stages_are_refused(stages: Any) -> None:
    model = Timed()
    model.given = stages
    with pytest.raises(UserError, match="stage"):
        declared_stages(model, FRAME)


@pytest.mark.parametrize("quick", [True, False])
def test_a_model_is_timed_in_both_scenarios(monkeypatch: pytest.MonkeyPatch, quick: bool) -> None:
    monkeypatch.setattr(module, "all_threads", lambda: 2)
    for name in ("CALLS", "QUICK_CALLS"):
        monkeypatch.setattr(module, name, 5)
    speed = time_model(Timed(), [FRAME] * 3, quick=quick)
    found = {(row["scenario"], row["threads"], row["batch"]) for row in speed.rows}
    assert found == {
        ("single", 1, 1),
        ("single", 2, 1),
        *(("offline", 2, batch) for batch in module.BATCHES),
    }
    assert {row["phase"] for row in speed.rows} == {"predict", "total"}
    assert speed.raw["single_1_threads_ms"].shape == (5, 1)
    assert f"offline_{module.BATCHES[-1]}_frames_cpu_ms" in speed.raw
    assert (speed.efficiency["parameters"], speed.efficiency["flops_per_frame"]) == (None, None)


PEAK = """
from tactibench.run import timing
small = timing._peak_mb()
block = bytearray(b"x") * 64_000_000
del block
large = timing._peak_mb()
print(small, large)
"""
"""Asked in a process of its own: an earlier test's larger array would hide this one."""


@pytest.mark.long
def test_a_large_array_shows_in_the_peak() -> None:
    said = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    small, large = (None if word == "None" else float(word) for word in said.stdout.split())
    if small is None or large is None:
        pytest.skip("this system does not tell the resident memory")
    assert large - small > 40
