"""Models timed in turns under a clock that only stages move."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench.run.latency import batches, time_in_rounds


class Clock:
    """Stands still until a stage says how long it takes; remembers who was called."""

    def __init__(self) -> None:
        self.now = 0.0
        self.called: list[str] = []

    def __call__(self) -> float:
        return self.now

    def stage(self, name, seconds):
        def run(frames):
            self.now += seconds
            self.called.append(name)
            return frames

        return run


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def models(clock):
    return {name: [("all", clock.stage(name, s))] for name, s in (("a", 0.001), ("b", 0.003))}


def test_all_are_called_in_turns_after_their_warm_ups(clock, models):
    found = time_in_rounds(models, "xyz", threads=1, calls=6, rounds=3, clock=clock, block=2)
    assert "".join(clock.called) == "aaaa" + "bbbb" + "aabb" * 3
    np.testing.assert_allclose(found["a"].total_ms, [1.0] * 6)
    np.testing.assert_allclose(found["b"].total_ms, [3.0] * 6)
    assert [(s.settled, s.warmup_calls, s.threads, s.batch) for s in found.values()] == [
        (True, 4, 1, 1)
    ] * 2


def test_a_spent_budget_leaves_one_round(clock, models):
    found = time_in_rounds(
        models, "xyz", threads=2, calls=8, rounds=4, budget_s=0.0, clock=clock, block=2
    )
    assert "".join(clock.called) == "aabb"
    assert [(s.settled, len(s.raw_ms)) for s in found.values()] == [(False, 2)] * 2


def test_batches(clock):
    seen = []
    model = {"only": [("all", lambda frames: seen.append(tuple(frames)))]}
    found = time_in_rounds(model, "abc", 2, threads=1, calls=2, rounds=1, clock=clock, block=1)
    assert set(seen) == {("a", "b"), ("c", "a")}
    assert found["only"].batch == 2
    assert batches("abc", 7) == [list("abcabca")]
    with pytest.raises(ValueError, match="batch is 0"):
        batches("abc", 0)


@pytest.mark.parametrize(("calls", "rounds"), [(3, 4), (3, 0)])
def test_a_round_needs_a_call(models, calls, rounds):
    with pytest.raises(ValueError, match="one call a round"):
        time_in_rounds(models, "abc", threads=1, calls=calls, rounds=rounds)


def test_impossible_jobs_are_refused(models):
    with pytest.raises(ValueError, match="timing needs"):
        time_in_rounds(models, "", threads=1)
    assert time_in_rounds({}, "abc", threads=1) == {}
