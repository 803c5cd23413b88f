"""A file that takes too long is refused with a sentence, and the next one is verified."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactibench import UserError
from tactibench.board import verification
from tactibench.board.time_limit import processor_time

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="the system has no timer of processor time"
)


def without_end() -> None:
    """Compute on, whatever goes wrong in it."""
    while True:
        try:
            int("x")
        except Exception:  # noqa: BLE001, S112 - as code does that must not end
            continue


def test_the_file_is_refused_and_the_others_go_on(
    submitted: Callable[..., Path], source: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, honest = submitted(), verification.score_again
    monkeypatch.setattr(verification, "score_again", lambda *_, **__: without_end())
    with pytest.raises(UserError, match=r"not verified within 0\.05 s of processor time"):
        verification.verify(path, source, limit_s=0.05)
    monkeypatch.setattr(verification, "score_again", honest)
    assert verification.verify(path, source).frames == 20


def test_a_limit_that_is_lost_in_a_destructor_comes_again(
    recwarn: pytest.WarningsRecorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Held:
        def __del__(self) -> None:
            without_end()

    lost: list[Any] = []
    monkeypatch.setattr("sys.unraisablehook", lost.append)

    def drop_and_go_on() -> None:
        Held()
        without_end()

    with pytest.raises(UserError, match="late"), processor_time(0.05, "late"):
        drop_and_go_on()
    assert len(lost) == 1


def test_nothing_is_left_of_a_limit() -> None:
    before = signal.getsignal(signal.SIGPROF)
    with processor_time(900.0, "late"):
        assert signal.getitimer(signal.ITIMER_PROF)[0] > 0
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGPROF) == before


def test_another_thread_has_no_limit() -> None:
    done: list[bool] = []

    def work() -> None:
        with processor_time(900.0, "late"):
            done.append(signal.getitimer(signal.ITIMER_PROF)[0] == 0)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]
