"""Memory that is really taken is seen, and so is that nothing tells it."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tactibench.run import timing as module

ASK = """
from tactibench.run.timing import _RESET, _RESET_PEAK, _peak_mb
small = _peak_mb()
block = bytearray(b"x") * 64_000_000
del block
large = _peak_mb()
try:
    _RESET.write_text(_RESET_PEAK)
    again = _peak_mb()
except OSError:
    again = None
print(small, large, again)
"""
"""Asked in a process of its own: an earlier test's larger array would hide this one."""


def test_a_large_array_shows_in_the_peak_until_it_is_reset():
    said = subprocess.run([sys.executable, "-c", ASK], capture_output=True, text=True, check=True)
    small, large, again = (None if word == "None" else float(word) for word in said.stdout.split())
    if small is None or large is None:
        pytest.skip("this system does not tell the resident memory")
    assert large - small > 40
    assert again is None or large - again > 40


def test_without_the_kernels_files_the_peak_of_the_life_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_STATUS", tmp_path / "none")
    peak_mb = module._peak_mb()
    assert peak_mb is None or peak_mb > 1
    monkeypatch.setitem(sys.modules, "resource", None)
    assert module._peak_mb() is None
