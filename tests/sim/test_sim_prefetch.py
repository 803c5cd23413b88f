"""Working ahead on threads: in order, bounded, stopped and failing cleanly."""

import threading

import pytest

from tactibench_sim.rendered_sensor import prefetch, thread_count


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_it_is_map(threads):
    assert list(prefetch(lambda k: k * k, range(50), threads)) == [k * k for k in range(50)]
    assert list(prefetch(lambda k: k, [], threads)) == []


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_it_looks_ahead_so_far_and_no_farther(threads):
    taken = 0

    def source():
        nonlocal taken
        while True:
            taken += 1
            yield taken

    results = prefetch(lambda k: k, source(), threads)
    for k in range(1, 20):
        assert next(results) == k
        assert taken <= k + threads + 1
    before = threading.active_count()
    results.close()
    assert threading.active_count() <= before
    assert not [t for t in threading.enumerate() if t.name.startswith("tactibench-sim")]


def test_several_threads_work_at_once():
    both = threading.Barrier(2, timeout=20)
    assert list(prefetch(lambda k: both.wait() >= 0, range(4), 2)) == [True] * 4


@pytest.mark.parametrize("threads", [1, 3])
def test_what_precedes_an_error_comes_first(threads):
    seen = []
    with pytest.raises(ZeroDivisionError):
        seen.extend(prefetch(lambda k: 1 / (5 - k), range(20), threads))
    results = prefetch(lambda k: 1 / (5 - k), range(20), threads)
    assert [next(results) for _ in range(5)] == [1 / (5 - k) for k in range(5)]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_threads_can_be_limited_from_outside(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert thread_count() == 3
    for nonsense in ("", "0", "many", "2,1"):
        monkeypatch.setenv("OMP_NUM_THREADS", nonsense)
        assert thread_count() >= 1
