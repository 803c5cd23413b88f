"""What stands between plugins and the process: exits, time limits, interruptions, escapes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

from tactibench.errors import (
    Interruption,
    PluginError,
    call_plugin,
    describe_exception,
    is_interruption,
    printable,
)
from tactibench.plugins import HookTimeoutError, time_limit


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("0.1 mm ± 2 °, Σ", "0.1 mm ± 2 °, Σ"),
        ("", ""),
        ("\x1b[2J\x1b]0;title\x07", r"\x1b[2J\x1b]0;title\x07"),
        ("one\ntwo\r\t", r"one\ntwo\r\t"),
        ("\x9b31m", r"\x9b31m"),
        ("abc\N{RIGHT-TO-LEFT OVERRIDE}def", r"abc\u202edef"),
        ("a\N{LINE SEPARATOR}b\N{ZERO WIDTH SPACE}", r"a\u2028b\u200b"),
        ("\ud800", r"\ud800"),
        ("a\N{NO-BREAK SPACE}b", "a\N{NO-BREAK SPACE}b"),
    ],
)
def test_what_a_terminal_would_obey_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(shown) == shown


def test_an_exception_that_cannot_be_read_is_described_all_the_same() -> None:
    class MuteError(Exception):
        def __str__(self) -> str:
            raise ValueError

    assert describe_exception(MuteError()) == "MuteError: its message cannot be read (ValueError)"


def raising(error: BaseException) -> Any:
    def call() -> None:
        raise error

    return call


@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda *_: None])
def test_whose_an_interruption_is(handler: Any) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert is_interruption(KeyboardInterrupt()), "Python's handler: it may be the user's"
        signal.signal(signal.SIGINT, handler)
        assert not is_interruption(KeyboardInterrupt()), "no signal can have raised it"
        assert is_interruption(Interruption())
        with pytest.raises(PluginError, match=r"^KeyboardInterrupt$"):
            call_plugin(raising(KeyboardInterrupt()))
        with pytest.raises(Interruption):
            call_plugin(raising(Interruption()))
    finally:
        signal.signal(signal.SIGINT, before)


def endless() -> None:
    with time_limit(0.05, "a block"):
        while True:
            pass


def test_a_time_limit_ends_a_block_and_leaves_no_alarm() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(HookTimeoutError, match=r"^it did not end within 0.05 s, stopped in \S+gua"):
        endless()
    with time_limit(60.0, "a block"):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 50
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0
    assert signal.getsignal(signal.SIGALRM) is before


def test_no_time_limit_beside_another_alarm_and_in_another_thread() -> None:
    def limited() -> None:
        with time_limit(1e-4, "a block"):
            end = time.monotonic() + 0.01
            while time.monotonic() < end:
                pass
        done.append(True)

    done: list[bool] = []
    thread = threading.Thread(target=limited)
    thread.start()
    thread.join()
    before = signal.signal(signal.SIGALRM, lambda *_: None)
    signal.setitimer(signal.ITIMER_REAL, 60.0)
    try:
        limited()
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 50
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert done == [True, True]


EXITS = """
import multiprocessing, os, sys, types
from tactibench.plugins.exits import ProcessExitError, forbid_exit
forbid_exit(); forbid_exit()
plugin = types.ModuleType("plugin")
code = "import os\\nfrom os import _exit\\nimport posix\\ndef end(how): eval(how)"
exec(code, plugin.__dict__)
for how in ("os._exit(0)", "_exit(3)", "posix._exit(0)", "os.abort()"):
    try:
        plugin.end(how)
    except ProcessExitError as error:
        print(error)
worker = types.ModuleType("distributed.process")
exec(code, worker.__dict__)
assert os.fork() or worker.end("os._exit(6)")
print(os.waitstatus_to_exitcode(os.wait()[1]))
child = os.fork()
if child == 0:
    plugin.end("os._exit(5)")
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
process = multiprocessing.get_context("fork").Process(target=print, args=("forked",))
process.start(); process.join(); print(process.exitcode)
sys.stdout.flush()
os._exit(7)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_only_a_plugin_in_this_very_process_cannot_end_it() -> None:
    done = subprocess.run([sys.executable, "-c", EXITS], capture_output=True, text=True)
    assert done.returncode == 7, done.stderr
    assert done.stdout.splitlines() == [
        "os._exit(0)",
        "os._exit(3)",
        "os._exit(0)",
        "os.abort()",
        "6",
        "5",
        "forked",
        "0",
    ]
