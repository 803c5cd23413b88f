"""The load of a machine from the text of /proc/stat."""

from __future__ import annotations

import pytest

from tactibench.run import Counters, Load, counters, load_between, machine_load, parse_stat

STAT = """cpu  400 0 200 3000 40 0 0 60 10 0
cpu0 100 10 100 1500 20 5 5 60 10 0
cpu1 300 0 100 1500 20 0 0 0 0 0
cpu2 9999 0 0 0 0 0 0 0 0 0
intr 1 2 3
"""


def test_only_the_processors_of_this_process_count():
    found = parse_stat(STAT, {0, 1}, 1.5, 0.01)
    assert found == Counters(pytest.approx(6.2), pytest.approx(0.6), pytest.approx(37.2), 2, 1.5)
    assert parse_stat(STAT, {7}, 0.0, 0.01) is None
    assert parse_stat("", {0}, 0.0, 0.01) is None


def test_an_old_kernel_counts_no_stolen_time():
    found = parse_stat("cpu0 100 0 100 800", {0}, 0.0, 0.01)
    assert found == Counters(2.0, 0.0, 10.0, 1, 0.0)


def test_shares_between_two_moments():
    before = Counters(10.0, 1.0, 100.0, 2, 5.0)
    after = Counters(13.0, 1.4, 104.0, 2, 7.0)
    found = load_between(before, after)
    assert found.foreign == pytest.approx(0.25)  # 3 s were computed, 2 by this process
    assert found.stolen == pytest.approx(0.1)
    assert found.others == pytest.approx(0.35)
    assert found.quiet is False


def test_rounding_of_ticks_is_no_negative_load():
    found = load_between(Counters(10.0, 1.0, 100.0, 1, 5.0), Counters(10.99, 1.0, 101.0, 1, 6.0))
    assert (found.foreign, found.stolen, found.quiet) == (0.0, 0.0, True)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (None, Counters(0, 0, 9, 1, 0)),
        (Counters(0, 0, 9, 1, 0), None),
        (Counters(0, 0, 0, 2, 0), Counters(0, 0, 0.39, 2, 0)),
        (Counters(0, 0, 0, 1, 0), Counters(0, 0, 9, 2, 0)),
    ],
)
def test_what_cannot_be_known_is_none(before, after):
    found = load_between(before, after)
    assert (found.stolen, found.foreign, found.others, found.quiet) == (None,) * 4


def test_the_machine_is_watched_while_this_process_waits():
    moments = iter([Counters(1, 0, 10, 2, 0.5), Counters(3, 0, 14, 2, 0.5)])
    waited = []
    found = machine_load(2.0, sleep=waited.append, counter=lambda: next(moments))
    assert waited == [2.0]
    assert found.foreign == pytest.approx(0.5)


def test_a_system_without_the_file(tmp_path):
    assert counters(path=tmp_path / "none") is None
    assert Load().quiet is None


def test_this_system_counts_forward():
    first, second = counters(), counters()
    if first is None or second is None:
        pytest.skip("this system does not count")
    assert second.total_s >= first.total_s > 0
    assert second.own_s >= first.own_s
