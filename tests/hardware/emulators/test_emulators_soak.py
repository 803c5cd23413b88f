"""Five thousand presses on an emulated stage: nothing grows, nothing is missed."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
from emulated import Stage

from tactibench_tactip.emulators.watch import Envelope

PRESSES, GROWTH_MB = 5000, 50.0
MEMORY = Path("/proc/self/statm")


def memory_mb() -> float:
    gc.collect()
    return int(MEMORY.read_text().split()[1]) * 4096 / 2**20


@pytest.mark.slow
@pytest.mark.skipif(not MEMORY.exists(), reason="this system does not tell a process's memory")
def test_five_thousand_presses() -> None:
    stage = Stage()
    stage.power_up()
    stage.say("$H")
    stage.after(60.0)
    stage.say("$J=G53 X-100 Y-100 Z-78 F3000")
    stage.after(20.0)
    stage.world.keep_to(Envelope(z=(-3.0, 5.0)))

    def press(count: int) -> None:
        for k in range(count):
            stage.say(f"$J=G53 Z-{81 + k % 30 / 10:.1f} F600")
            stage.after(0.8, b"?")
            stage.say("$J=G53 Z-78 F3000")
            stage.after(0.3)

    press(200)
    before = memory_mb()
    press(PRESSES)
    assert memory_mb() - before < GROWTH_MB
    assert stage.world.presses == PRESSES + 200
    assert not stage.world.excursions
