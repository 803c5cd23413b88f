"""Plugins that misbehave: each is named, with its file and line, and the exit code is right.

Every kind is a distribution of its own, called in a process of its own.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from few_presses import few_presses

pytestmark = pytest.mark.long

FAKE = Path(__file__).parents[1] / "run" / "fake"
HOOKS = """
@hookimpl
def tactibench_models():
    {hook}
    return [ModelSpec("bad", "dist_bad_heavy:Bad", "a model")]

@hookimpl
def tactibench_sensors():
    return [SensorSpec("tiny", "tiny_tactile.parts:TinySensor", "twenty pixels")]
"""
MODULE = """
import os, signal, sys, threading, time
import numpy as np
import tactibench
from tactibench import Contacts, FitReport

{module}

def right(frames):
    return [Contacts([[0.0, 0.0]], [1.0], [1.0]) for _ in frames]

class Bad(tactibench.Model):
    def __init__(self, context):
        {init}

    def fit(self, frames, truth, *, validation, rng, progress):
        {fit}
        return FitReport()

    def predict(self, frames):
        {predict}
        return right(frames)

    def save(self, directory):
        (directory / "weights").write_text("none")

    def load(self, directory):
        pass

    {more}
"""
LIST = ("list", "models")
RUN = ("run", "protocols/few-exp1.toml", "--model", "bad", "--sensor", "tiny")
HANG = "while True: time.sleep(0.01)"
STUBBORN = """
while True:
    try:
        time.sleep(0.01)
    except BaseException:
        pass
"""
Call = Callable[..., Any]


@pytest.fixture
def bad(
    install: Any, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tactibench: Call
) -> Call:
    """Code for the places of a plugin -> what a command beside it says."""
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join(filter(None, [str(FAKE), os.environ.get("PYTHONPATH")]))
    )
    monkeypatch.setenv("TACTIBENCH_HOOK_SECONDS", "1")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.chdir(tmp_path)
    few_presses(tmp_path / "protocols")

    def called(arguments: tuple[str, ...], top: str = "", hook: str = "", **code: str) -> Any:
        install("bad", "import os, time\n" + top + HOOKS.format(hook=hook or "pass"))
        places = {name: code.get(name, "pass") for name in ("module", "init", "fit", "predict")}
        text = MODULE.format(**places, more=code.get("more", ""))
        (site / "dist_bad_heavy.py").write_text(text, encoding="utf-8")
        return tactibench(*arguments)

    return called


WHO = "plugin 'bad' (dist-bad 1.2)"
BROKEN_HOOKS = {
    "hangs at import": ({"top": HANG}, "in step load: HookTimeoutError: it did not end within 1 s"),
    "hangs in a hook": ({"hook": HANG}, "in step declare: tactibench_models raised HookTimeoutErr"),
    "SystemExit at import": ({"top": "raise SystemExit(0)"}, "step load: SystemExit: 0"),
    "SystemExit in a hook": ({"hook": "raise SystemExit(0)"}, "raised SystemExit: 0"),
    "os._exit at import": ({"top": "os._exit(0)"}, "step load: ProcessExitError: os._exit(0)"),
    "os._exit in a hook": ({"hook": "os._exit(0)"}, "raised ProcessExitError: os._exit(0)"),
    "os.abort at import": ({"top": "os.abort()"}, "step load: ProcessExitError: os.abort()"),
    "KeyboardInterrupt at import": ({"top": "raise KeyboardInterrupt"}, "load: KeyboardInterrupt"),
    "KeyboardInterrupt in a hook": ({"hook": "raise KeyboardInterrupt"}, "raised KeyboardInterr"),
    "an error with escapes": ({"top": r"raise ValueError('\x1b[2Jgone')"}, r"\x1b[2Jgone"),
    "a summary that is none": (
        {"hook": "return [ModelSpec('x', 'a:B', None)]"},
        "'x' has a summary of type NoneType",
    ),
}


@pytest.mark.parametrize(("code", "words"), BROKEN_HOOKS.values(), ids=BROKEN_HOOKS)
def test_a_plugin_that_breaks_when_it_is_read_is_named_and_stops_nobody(
    bad: Call, tactibench: Call, code: dict[str, str], words: str
) -> None:
    listed = bad(LIST, **code)
    assert listed.returncode == 0, listed.stderr
    assert "  unet " in listed.stdout
    assert listed.stderr == "1 plugin problem: run `tactibench doctor`.\n"
    doctor = tactibench("doctor")
    assert doctor.returncode == 1
    (line,) = [line for line in doctor.stdout.splitlines() if line.startswith("broken")]
    assert WHO in line
    assert words in line
    assert "\x1b" not in listed.stdout + doctor.stdout


def test_a_hook_that_cannot_be_stopped_is_named_and_ends_the_command(bad: Call) -> None:
    done = bad(LIST, top=STUBBORN)
    assert done.returncode == 2
    assert re.fullmatch(
        r"tactibench: plugin 'bad' \(dist-bad 1.2\): its import did not end within 1 s, stopped in "
        r"\S+dist_bad_hooks.py, line \d+, and went on; uninstall it, or set "
        r"TACTIBENCH_HOOK_SECONDS to wait longer.\n",
        done.stderr,
    )


def test_a_time_limit_that_is_none_is_refused(bad: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTIBENCH_HOOK_SECONDS", "soon")
    done = bad(LIST)
    assert (done.returncode, done.stderr) == (
        2,
        "tactibench: TACTIBENCH_HOOK_SECONDS is 'soon'; give a number of seconds above 0.\n",
    )


def in_code(raised: str, place: str) -> str:
    return (
        rf"{re.escape(WHO)} raised {raised} in \S*{place} \(\S+dist_bad_heavy.py, line \d+\); fix"
    )


def answer(words: str, place: str = "Bad.predict") -> str:
    return rf"the model {words}.*; fix {place} \(\S+dist_bad_heavy.py, line \d+\)"


EXIT = r"ProcessExitError: os._exit\(0\)"
NAN = "c = right(frames); c[0].xy.flags.writeable = True; c[0].xy[:] = np.nan; return c"
NEGATIVE = "c = right(frames); c[0].score.flags.writeable = True; c[0].score[:] = -1; return c"
WRONG = {
    "SystemExit at its import": (
        {"module": "sys.exit(0)"},
        r"dist_bad_heavy:Bad does not load \(SystemExit: 0\)",
    ),
    "os._exit at its import": (
        {"module": "os._exit(0)"},
        r"does not load \(ProcessExitError: os._exit\(0\)\)",
    ),
    "raises when built": ({"init": "1 / 0"}, in_code("ZeroDivisionError: .*", "__init__")),
    "SystemExit in fit": ({"fit": "sys.exit(0)"}, in_code("SystemExit: 0", "fit")),
    "os._exit in fit": (
        {"fit": "os._exit(0)"},
        in_code(EXIT, "fit"),
    ),
    "KeyboardInterrupt in fit": (
        {"fit": "raise KeyboardInterrupt"},
        in_code("KeyboardInterrupt", "fit"),
    ),
    "fit gives None": (
        {"fit": "return None"},
        "fit of model 'bad' gave NoneType where",
    ),
    "raises in predict": (
        {"predict": "raise ValueError('no pins')"},
        in_code("ValueError: no pins", "predict"),
    ),
    "EOFError in predict": ({"predict": "raise EOFError"}, in_code("EOFError", "predict")),
    "SystemExit in predict": ({"predict": "sys.exit(0)"}, in_code("SystemExit: 0", "predict")),
    "os._exit in predict": (
        {"predict": "os._exit(0)"},
        in_code(EXIT, "predict"),
    ),
    "posix._exit in predict": (
        {"predict": "import posix; posix._exit(0)"},
        in_code(EXIT, "predict"),
    ),
    "os.abort in predict": (
        {"predict": "os.abort()"},
        in_code("ProcessExitError: os.abort\\(\\)", "predict"),
    ),
    "KeyboardInterrupt in predict": (
        {"predict": "raise KeyboardInterrupt"},
        in_code("KeyboardInterrupt", "predict"),
    ),
    "a file that is not there": (
        {"predict": "open('/no/such/file')"},
        r"refused /no/such/file \(plugin 'bad' \(dist-bad 1.2\) asked in \S+predict",
    ),
    "an error with escapes": (
        {"predict": r"raise ValueError('\x1b[2Jgone')"},
        in_code(re.escape(r"ValueError: \x1b[2Jgone"), "predict"),
    ),
    "None": ({"predict": "return None"}, answer("gave None where a list")),
    "a generator": (
        {"predict": "return (c for c in right(frames))"},
        answer("gave a generator where a list"),
    ),
    "a number": ({"predict": "return 7"}, answer("gave a int where a list")),
    "a wrong count": ({"predict": "return right(frames) * 3"}, answer("gave 3 answers for one")),
    "a wrong type": ({"predict": "return ['here']"}, answer("answered str where Contacts")),
    "a wrong shape": (
        {"predict": "return [Contacts([0.0, 0.0], [1.0], [1.0])]"},
        in_code("ValueError: .*", "predict"),
    ),
    "NaN": (
        {"predict": "return [Contacts([[np.nan, 0.0]], [1.0], [1.0])]"},
        in_code("NotFiniteError: .*", "predict"),
    ),
    "NaN that was hidden": (
        {"predict": NAN},
        answer("answered Contacts with a number"),
    ),
    "negative scores": (
        {"predict": "return [Contacts([[0.0, 0.0]], [1.0], [-1.0])]"},
        in_code("ValueError: score lies outside 0..1", "predict"),
    ),
    "negative scores that were hidden": (
        {"predict": NEGATIVE},
        answer("answered a contact with a score outside"),
    ),
    "maps of a wrong shape": (
        {"more": "def maps(self, frames): return np.zeros((1, 1, 2, 2), np.float32)"},
        answer("gave maps of shape \\(1, 1, 2, 2\\)", "Bad.maps"),
    ),
    "maps of nothing": (
        {"more": "def maps(self, frames): return ['heat']"},
        answer("gave a list where an array of maps is asked", "Bad.maps"),
    ),
    "stages that are none": (
        {"more": "def stages(self): return [('predict', 7)]"},
        "stages of the model are no list of .*; fix Bad.stages",
    ),
    "a count that is none": (
        {"more": "def parameter_count(self): return 'many'"},
        "gave 'many' where a whole number or None is asked; fix Bad.parameter_count",
    ),
    "sets torch's threads": (
        {"predict": "import torch; torch.set_num_threads(3)"},
        "the model set torch's threads to 3 while it was timed with",
    ),
}


@pytest.mark.parametrize(("code", "words"), WRONG.values(), ids=WRONG)
def test_a_model_that_misbehaves_is_one_sentence_and_stores_nothing(
    bad: Call, tmp_path: Path, code: dict[str, str], words: str
) -> None:
    done = bad((*RUN, "--store", "runs"), **code)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("tactibench: ")
    assert done.stderr.count("\n") == 1
    assert re.search(words, done.stderr), done.stderr
    assert "\x1b" not in done.stderr
    assert not list(tmp_path.glob("runs/*/record.json"))


def test_debug_shows_where_a_model_wanted_to_end_the_process(bad: Call) -> None:
    done = bad(("--debug", *RUN), predict="sys.exit(0)")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "dist_bad_heavy.py" in done.stderr
    assert done.stderr.rstrip().endswith("PluginError: SystemExit: 0")


def test_a_crash_in_compiled_code_shows_the_line_that_led_to_it(bad: Call) -> None:
    done = bad(RUN, predict="import ctypes; ctypes.string_at(0)")
    assert done.returncode == -signal.SIGSEGV
    assert re.search(r'File "\S+dist_bad_heavy.py", line \d+ in predict', done.stderr)


THREADS = "threading.Thread(target={0}, args={1}, daemon={2}).start()"


@pytest.mark.parametrize(
    ("target", "arguments", "daemon", "words"),
    [
        ("forever", "()", False, r"left the thread 'Thread-\d+ \(forever\)' running in forever"),
        ("forever", "()", True, r"left the thread 'Thread-\d+ \(forever\)' running in forever"),
        ("time.sleep", "(1e6,)", False, r"the threads Thread-\d+ \(sleep\) still run; they are st"),
    ],
)
def test_threads_that_never_end_are_named_and_keep_nobody(
    bad: Call, target: str, arguments: str, daemon: bool, words: str
) -> None:
    forever = "def forever():\n    while True: time.sleep(0.01)\n"
    start = THREADS.format(target, arguments, daemon)
    done = bad((*RUN, "--store", "runs"), module=forever, init=start)
    assert done.returncode == 0, done.stderr
    assert re.search(words, done.stderr), done.stderr
    assert done.stderr.startswith("tactibench: ")


def test_check_stops_at_the_first_cause_and_shows_file_and_line(bad: Call) -> None:
    check = ("check", "bad", "--sensor", "tiny")
    done = bad(check, fit="raise ValueError('no pins')")
    assert done.returncode == 1
    failed = [line for line in done.stdout.splitlines() if line.startswith("  failed")]
    assert len(failed) == 1
    assert re.search(
        r"raised ValueError: no pins in Bad.fit \(\S+dist_bad_heavy.py, line 17\)$", failed[0]
    )
    assert re.search(r"; \d+ not checked, fix this first$", done.stdout.rstrip())


def test_an_aborting_model_ends_its_own_cell_only(bad: Call, tmp_path: Path) -> None:
    for package in ("distributed", "cryptography"):
        pytest.importorskip(package, reason="the engine of sweeps is an extra of its own")
    keys = 'protocol = "protocols/few-exp1.toml"\nsensor = "tiny"\nmodel = ["bad", "mean"]\n'
    (tmp_path / "sweep.toml").write_text(keys, encoding="utf-8")
    done = bad(("sweep", "sweep.toml", "--workers", "1"), predict="os._exit(0)")
    assert done.returncode == 1, done.stderr
    assert "2 cells: 1 failed, 1 run;" in done.stdout
    text = " ".join(done.stdout.split())
    assert f"{WHO} raised ProcessExitError: os._exit(0) in Bad.predict" in text
