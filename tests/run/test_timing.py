"""Memory that is really taken is seen; what a model does not know is None."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tactibench import Frame, Pose
from tactibench.run import timing as module
from tactibench.run.timing import peak_memory

FRAME = Frame(np.zeros((4, 4), np.uint8), 0.0, Pose())


ASK = """
from tactibench.run.timing import peak_memory
with peak_memory() as small:
    pass
with peak_memory() as large:
    block = bytearray(b"x") * 64_000_000
    del block
print(small.mb, large.mb)
"""
"""Asked in a process of its own: where the kernel cannot reset the peak, an earlier test's larger
array would hide this one."""


def test_a_large_array_shows_in_the_peak():
    said = subprocess.run([sys.executable, "-c", ASK], capture_output=True, text=True, check=True)
    small, large = (None if word == "None" else float(word) for word in said.stdout.split())
    if small is None or large is None:
        pytest.skip("this system does not tell the resident memory")
    assert large - small > 40


def test_without_the_kernels_files_the_peak_of_the_life_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_STATUS", tmp_path / "none")
    monkeypatch.setattr(module, "_RESET", tmp_path / "no" / "folder")
    with peak_memory() as found:
        pass
    assert found.mb is None or found.mb > 1
    monkeypatch.setitem(sys.modules, "resource", None)
    with peak_memory() as found:
        pass
    assert found.mb is None
