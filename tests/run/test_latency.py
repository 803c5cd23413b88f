"""Latency under a clock that only stages move, and rows of raw times against closed forms."""

from __future__ import annotations

import gc
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench.run import (
    Clocks,
    Counters,
    LatencySample,
    Load,
    batches,
    limited_threads,
    time_calls,
    time_in_rounds,
)


class Clock:
    """Stands still until a stage says how long it takes; remembers the names of the called."""

    def __init__(self) -> None:
        self.now = 100.0
        self.called: list[str] = []
        self.share = 1.0
        self.foreign_s = 0.0
        self.stolen_s = 0.0

    @property
    def clocks(self) -> Clocks:
        """The clocks of a process that computes ``share`` of the time, on two processors."""
        return Clocks(self, lambda: self.share * self.now, self.counters)

    def counters(self) -> Counters:
        busy = self.share * self.now + self.foreign_s
        return Counters(busy, self.stolen_s, 2 * self.now, 2, self.share * self.now)

    def __call__(self) -> float:
        return self.now

    def stage(self, seconds, then=lambda value: value, name=""):
        """A stage that takes ``seconds(call number)`` and returns ``then(value)``."""
        count = 0

        def run(value):
            nonlocal count
            self.now += seconds(count)
            count += 1
            self.called.append(name)
            return then(value)

        return run


def constant(seconds):
    return lambda call: seconds


def test_phases_are_timed_apart():
    clock = Clock()
    stages = [
        ("preprocess", clock.stage(constant(0.001))),
        ("forward", clock.stage(constant(0.004))),
    ]
    sample = time_calls(stages, ["a"], threads=1, clocks=clock.clocks)
    assert sample.phases == ("preprocess", "forward")
    assert sample.raw_ms.shape == (300, 2)
    np.testing.assert_allclose(sample.raw_ms, np.tile([1.0, 4.0], (300, 1)), rtol=1e-6)
    np.testing.assert_allclose(sample.total_ms, 5.0, rtol=1e-6)
    assert (sample.settled, sample.warmup_calls, sample.batch) == (True, 40, 1)


def test_each_stage_gets_what_the_one_before_returned():
    seen = []
    stages = [("one", lambda frames: [f + 1 for f in frames]), ("two", seen.append)]
    time_calls(stages, [10, 20, 30], threads=1, calls=4, budget_s=0.0, clocks=Clock().clocks)
    assert seen == [[11], [21], [31], [11]]  # a budget already spent: no warm-up at all


def test_warm_up_goes_on_while_calls_get_faster():
    """Blocks of 20: 2.0, 1.0, 1.0 s: the third agrees with the second, the second not."""
    clock = Clock()
    stages = [("all", clock.stage(lambda call: 2.0 if call < 20 else 1.0))]
    sample = time_calls(stages, [0], threads=1, clocks=clock.clocks)
    assert (sample.settled, sample.warmup_calls) == (True, 60)
    np.testing.assert_allclose(sample.raw_ms, 1000.0)


@pytest.mark.parametrize(("change", "settles"), [(0.019, True), (0.021, False)])
def test_settled_means_within_two_percent(change, settles):
    clock = Clock()
    stages = [("all", clock.stage(lambda call: (1 - change) ** (call // 20)))]
    sample = time_calls(stages, [0], threads=1, clocks=clock.clocks)
    assert sample.settled is settles
    assert sample.warmup_calls == (40 if settles else 500)


def test_outliers_do_not_keep_it_from_settling():
    clock = Clock()
    stages = [("all", clock.stage(lambda call: 9.0 if call == 25 else 1.0))]
    assert time_calls(stages, [0], threads=1, clocks=clock.clocks).warmup_calls == 40


def test_budget_stops_but_leaves_a_block():
    clock = Clock()
    stages = [("all", clock.stage(constant(1.0)))]
    sample = time_calls(stages, [0], threads=1, budget_s=100.0, clocks=clock.clocks)
    assert sample.settled
    assert len(sample.raw_ms) == 60  # 40 of the 100 went into the warm-up
    sample = time_calls(stages, [0], threads=1, budget_s=15.0, clocks=clock.clocks)
    assert (sample.settled, sample.warmup_calls, len(sample.raw_ms)) == (False, 20, 20)


def test_offline_batches_take_frames_in_turn():
    clock, seen = Clock(), []

    def look(frames):
        seen.append(tuple(frames))
        clock.now += 0.5

    sample = time_calls([("all", look)], "abcde", 2, threads=2, calls=6, clocks=clock.clocks)
    assert sample.batch == 2
    assert sample.threads == 2
    assert len(sample.raw_ms) == 6
    assert set(seen) == {("a", "b"), ("c", "d"), ("e", "a")}
    with pytest.raises(ValueError, match="batch"):
        time_calls([("all", look)], "abc", 0, threads=1, clocks=clock.clocks)
    big = time_calls([("all", look)], "abc", 7, threads=1, clocks=clock.clocks)
    assert {len(s) for s in seen} == {2, 7}
    assert big.batch == 7


@pytest.mark.parametrize("was_on", [True, False])
def test_collector_is_off_in_calls_and_restored(was_on):
    states = []

    def fail(value):
        states.append(gc.isenabled())
        if len(states) > 50:
            raise RuntimeError("stop")

    before = gc.isenabled()
    try:
        (gc.enable if was_on else gc.disable)()
        with pytest.raises(RuntimeError, match="stop"):
            time_calls([("all", fail)], [0], threads=1, clocks=Clock().clocks)
        assert gc.isenabled() is was_on
    finally:
        (gc.enable if before else gc.disable)()
    assert not any(states)


@pytest.mark.parametrize(
    ("stages", "frames", "calls"),
    [
        ([], [0], 1),
        ([("a", id)], [], 1),
        ([("a", id)], [0], 0),
        ([("a", id), ("a", id)], [0], 1),
        ([("total", id)], [0], 1),
    ],
)
def test_impossible_jobs_are_refused(stages, frames, calls):
    with pytest.raises(ValueError, match=r"timing needs|different names"):
        time_calls(stages, frames, threads=1, calls=calls)


def test_the_real_clock_runs_forward():
    sample = time_calls([("sum", lambda frames: sum(range(1000)))], [0], threads=1, calls=50)
    assert (sample.raw_ms > 0).all()


class FakeTorch:
    threads = 7

    @classmethod
    def get_num_threads(cls):
        return cls.threads

    @classmethod
    def set_num_threads(cls, count):
        cls.threads = count


def test_torch_threads_are_restored_after_an_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", FakeTorch)
    inside = []

    def use():
        with limited_threads(3):
            inside.append(FakeTorch.threads)
            raise RuntimeError("inside")

    with pytest.raises(RuntimeError, match="inside"):
        use()
    assert inside == [3]
    assert FakeTorch.threads == 7


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def models(clock):
    return {
        name: [("all", clock.stage(constant(s), name=name))]
        for name, s in (("a", 0.001), ("b", 0.003))
    }


def test_all_are_called_in_turns_after_their_warm_ups(clock, models):
    found = time_in_rounds(
        models, "xyz", threads=1, calls=6, rounds=3, clocks=clock.clocks, block=2
    )
    assert "".join(clock.called) == "aaaa" + "bbbb" + "aabb" * 3
    np.testing.assert_allclose(found["a"].total_ms, [1.0] * 6)
    np.testing.assert_allclose(found["b"].total_ms, [3.0] * 6)
    assert [(s.settled, s.warmup_calls, s.threads, s.batch) for s in found.values()] == [
        (True, 4, 1, 1)
    ] * 2


def test_a_spent_budget_leaves_one_round(clock, models):
    found = time_in_rounds(
        models, "xyz", threads=2, calls=8, rounds=4, budget_s=0.0, clocks=clock.clocks, block=2
    )
    assert "".join(clock.called) == "aabb"
    assert [(s.settled, len(s.raw_ms)) for s in found.values()] == [(False, 2)] * 2


def test_rounds_of_batches(clock):
    seen = []
    model = {"only": [("all", lambda frames: seen.append(tuple(frames)))]}
    found = time_in_rounds(
        model, "abc", 2, threads=1, calls=2, rounds=1, clocks=clock.clocks, block=1
    )
    assert set(seen) == {("a", "b"), ("c", "a")}
    assert found["only"].batch == 2
    assert batches("abc", 7) == [list("abcabca")]
    with pytest.raises(ValueError, match="batch is 0"):
        batches("abc", 0)


@pytest.mark.parametrize(("calls", "rounds"), [(3, 4), (3, 0)])
def test_a_round_needs_a_call(models, calls, rounds):
    with pytest.raises(ValueError, match="one call a round"):
        time_in_rounds(models, "abc", threads=1, calls=calls, rounds=rounds)


def test_impossible_rounds_are_refused(models):
    with pytest.raises(ValueError, match="timing needs"):
        time_in_rounds(models, "", threads=1)
    assert time_in_rounds({}, "abc", threads=1) == {}


def test_quantiles_of_a_ramp():
    """0, 1 .. 100 ms: the q quantile is 100 q, the mean 50 ms, 4 frames a call: 80 a second."""
    ramp = np.arange(101.0)
    raw = np.column_stack([0.25 * ramp, 0.75 * ramp])
    rows = LatencySample(("forward", "decode"), raw, True, 40, 2, 4, raw, Load()).rows("offline")
    assert [row["phase"] for row in rows] == ["forward", "decode", "total"]
    for row, share in zip(rows, (0.25, 0.75, 1.0), strict=True):
        assert row["p50_ms"] == pytest.approx(50 * share)
        assert row["p90_ms"] == pytest.approx(90 * share)
        assert row["p99_ms"] == pytest.approx(99 * share)
        assert row["mean_ms"] == pytest.approx(50 * share)
        assert row["per_s"] == pytest.approx(80)
        assert (row["scenario"], row["threads"], row["batch"]) == ("offline", 2, 4)
        assert row["settled"] is True


@given(arrays(np.float64, (17, 3), elements=st.floats(0.001, 1e4)))
def test_rows_are_ordered_and_add_up(raw):
    rows = LatencySample(("a", "b", "c"), raw, False, 500, 1, 1, raw, Load()).rows("single")
    for row in rows:
        assert row["p50_ms"] <= row["p90_ms"] <= row["p99_ms"]
        assert row["settled"] is False
    assert sum(row["mean_ms"] for row in rows[:3]) == pytest.approx(rows[3]["mean_ms"])
    assert rows[3]["per_s"] == pytest.approx(1e3 / rows[3]["mean_ms"])


def test_json_values_only():
    raw = np.ones((1, 1))
    for row in LatencySample(("a",), raw, True, 40, 1, 1, raw, Load()).rows("single"):
        assert {type(value) for value in row.values()} <= {str, int, float, bool, type(None)}


def timed(clock, threads=1):
    stages = [("all", clock.stage(constant(0.01)))]
    return time_calls(stages, [0], threads=threads, calls=100, clocks=clock.clocks)


@pytest.mark.parametrize(
    ("share", "settled"), [(1.0, True), (0.91, True), (0.89, False), (1.09, True), (1.2, False)]
)
def test_one_thread_is_settled_where_processor_and_wall_time_agree(share, settled):
    clock = Clock()
    clock.share = share
    sample = timed(clock)
    assert (sample.warm, sample.settled) == (True, settled)
    (row, total) = sample.rows("single")
    assert row["cpu_ms"] == total["cpu_ms"] == pytest.approx(10 * share)
    assert total["settled"] is settled


@pytest.mark.parametrize(
    ("threads", "share", "foreign_s", "stolen_s", "settled"),
    [
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
def test_times_are_settled_where_others_took_little(threads, share, foreign_s, stolen_s, settled):
    """100 calls of 10 ms on two processors: 2 s, of which others may take 0.2."""
    clock = Clock()
    clock.share = share

    def disturbed(value):
        clock.now += 0.01
        clock.foreign_s += foreign_s / 100
        clock.stolen_s += stolen_s / 100
        return value

    sample = time_calls([("all", disturbed)], [0], threads=threads, calls=100, clocks=clock.clocks)
    assert sample.settled is settled
    (row,) = [row for row in sample.rows("single") if row["phase"] == "total"]
    assert row["foreign"] == pytest.approx(foreign_s / 2, abs=1e-9)
    assert row["stolen"] == pytest.approx(stolen_s / 2, abs=1e-9)


def test_times_are_not_settled_while_they_drift():
    clock = Clock()
    stages = [("all", clock.stage(lambda call: 0.97 ** (call // 20)))]
    sample = time_calls(stages, [0], threads=1, clocks=clock.clocks)
    assert (sample.warm, sample.quiet, sample.settled) == (False, True, False)


def test_too_short_to_know_the_load(clock):
    sample = time_calls(
        [("all", clock.stage(constant(0.001)))], [0], threads=2, calls=100, clocks=clock.clocks
    )
    assert (sample.load.stolen, sample.load.foreign) == (None, None)
    assert sample.settled


def test_frames_of_every_model_may_be_its_own(clock):
    seen = {"a": set(), "b": set()}
    models = {name: [("all", lambda frames, n=name: seen[n].update(frames))] for name in seen}
    rounds = []
    time_in_rounds(
        models,
        {"a": "xy", "b": "z"},
        threads=1,
        calls=4,
        rounds=2,
        clocks=clock.clocks,
        block=1,
        advance=rounds.append,
    )
    assert seen == {"a": {"x", "y"}, "b": {"z"}}
    assert rounds == [1, 1]


def test_phases_have_processor_times_of_their_own(clock):
    def compute(value):
        clock.now += 0.003
        return value

    sample = time_calls(
        [("one", compute), ("two", clock.stage(constant(0.001)))],
        [0],
        threads=1,
        calls=100,
        clocks=clock.clocks,
    )
    rows = {row["phase"]: row["cpu_ms"] for row in sample.rows("single")}
    assert rows == pytest.approx({"one": 3.0, "two": 1.0, "total": 4.0})
    assert sample.load == Load(0.0, 0.0, sample.load.average)
