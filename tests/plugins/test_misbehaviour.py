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
    return [ModelSpec("bad", "dist_bad_heavy:Bad", "a model")]

@hookimpl
def tactibench_sensors():
    return [SensorSpec("tiny", "tiny_tactile.parts:TinySensor", "twenty pixels")]
"""
MODULE = """
import sys
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
RUN = ("--quiet", "run", "protocols/few-exp1.toml", "--model", "bad", "--sensor", "tiny")
Call = Callable[..., Any]


@pytest.fixture
def bad(
    install: Any, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tactibench: Call
) -> Call:
    """Code for the places of a plugin -> what a command beside it says."""
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join(filter(None, [str(FAKE), os.environ.get("PYTHONPATH")]))
    )
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.chdir(tmp_path)
    few_presses(tmp_path / "protocols")

    def called(arguments: tuple[str, ...], **code: str) -> Any:
        install("bad", HOOKS)
        places = {name: code.get(name, "pass") for name in ("module", "init", "fit", "predict")}
        text = MODULE.format(**places, more=code.get("more", ""))
        (site / "dist_bad_heavy.py").write_text(text, encoding="utf-8")
        return tactibench(*arguments)

    return called


WHO = "plugin 'bad' (dist-bad 1.2)"


def in_code(raised: str, place: str) -> str:
    return (
        rf"{re.escape(WHO)} raised {raised} in \S*{place} \(\S+dist_bad_heavy.py, line \d+\); fix"
    )


def answer(words: str, place: str = "Bad.predict") -> str:
    return rf"the model {words}.*; fix {place} \(\S+dist_bad_heavy.py, line \d+\)"


WRONG = {
    "SystemExit at its import": (
        {"module": "sys.exit(0)"},
        r"dist_bad_heavy:Bad does not load \(SystemExit: 0\)",
    ),
    "raises when built": ({"init": "1 / 0"}, in_code("ZeroDivisionError: .*", "__init__")),
    "fit gives None": (
        {"fit": "return None"},
        "fit of model 'bad' gave NoneType where",
    ),
    "raises in predict": (
        {"predict": "raise ValueError('no pins')"},
        in_code("ValueError: no pins", "predict"),
    ),
    "SystemExit in predict": ({"predict": "sys.exit(0)"}, in_code("SystemExit: 0", "predict")),
    "a file that is not there": (
        {"predict": "open('/no/such/file')"},
        r"refused /no/such/file \(plugin 'bad' \(dist-bad 1.2\) asked in \S+predict",
    ),
    "a number": ({"predict": "return 7"}, answer("gave a int where a list")),
    "a wrong type": ({"predict": "return ['here']"}, answer("answered str where Contacts")),
    "NaN": (
        {"predict": "return [Contacts([[np.nan, 0.0]], [1.0], [1.0])]"},
        in_code("NotFiniteError: .*", "predict"),
    ),
    "maps of a wrong shape": (
        {"more": "def maps(self, frames): return np.zeros((1, 1, 2, 2), np.float32)"},
        answer("gave maps of shape \\(1, 1, 2, 2\\)", "Bad.maps"),
    ),
    "stages that are none": (
        {"more": "def stages(self): return [('predict', 7)]"},
        "stages of the model are no list of .*; fix Bad.stages",
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


def test_debug_shows_where_a_model_ended_the_command(bad: Call) -> None:
    done = bad((*RUN, "--debug"), predict="sys.exit(0)")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert re.search("UserError: .*" + in_code("SystemExit: 0", "predict"), done.stderr)


def test_a_crash_in_compiled_code_shows_the_line_that_led_to_it(bad: Call) -> None:
    done = bad(RUN, predict="import ctypes; ctypes.string_at(0)")
    assert done.returncode == -signal.SIGSEGV
    assert re.search(r'File "\S+dist_bad_heavy.py", line \d+ in predict', done.stderr)


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
