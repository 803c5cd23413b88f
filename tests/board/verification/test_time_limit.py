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
from tactibench.board.alarm import alarm

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="the system has no timer of processor time"
)


def compute_without_end(*_: object, **__: object) -> None:
    """Go on, whatever goes wrong in it."""
    while True:
        try:
            int("x")
        except Exception:  # noqa: BLE001, S112 - as code does that must not end
            continue


class Endless:
    """What is raised while it goes away is lost."""

    def __del__(self) -> None:
        compute_without_end()


def lose_the_first_alarm(*_: object, **__: object) -> None:
    Endless()
    compute_without_end()


@pytest.mark.parametrize("work", [compute_without_end, lose_the_first_alarm])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_file_is_refused_and_the_others_go_on(
    submitted: Callable[..., Path], source: Any, monkeypatch: pytest.MonkeyPatch, work: Any
) -> None:
    path, honest = submitted(), verification.score_again
    monkeypatch.setattr(verification, "score_again", work)
    with pytest.raises(UserError, match=r"not verified within 0\.05 s of processor time"):
        verification.verify(path, source, limit_s=0.05)
    monkeypatch.setattr(verification, "score_again", honest)
    assert verification.verify(path, source).frames == 20
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)


def test_there_is_no_alarm_beside_another_and_in_another_thread() -> None:
    def limited() -> None:
        before = signal.getsignal(signal.SIGPROF)
        with alarm("processor", 900.0, compute_without_end, again_s=1.0):
            same.append(signal.getsignal(signal.SIGPROF) is before)

    same: list[bool] = []
    thread = threading.Thread(target=limited)
    thread.start()
    thread.join()
    with alarm("processor", 900.0, compute_without_end, again_s=1.0):
        limited()
    limited()
    assert same == [True, True, False]
