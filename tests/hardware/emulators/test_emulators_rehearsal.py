"""Emulators in a process of their own, as the commands use them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from emulated import GraySensor
from fake_station import make_settings

from tactibench import Indenter, UserError
from tactibench_tactip.camera import Camera
from tactibench_tactip.emulators import Fault, HiddenOffset, Rehearsal, rehearse

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def rehearsal() -> Iterator[Rehearsal]:
    settings = make_settings()
    with rehearse(settings, sensor=GraySensor(), hidden=HiddenOffset(x=0.5), noise=0.0) as found:
        yield found


def test_the_default_is_as_slow_as_the_real_thing(rehearsal: Rehearsal) -> None:
    assert rehearsal.settings.robot.time_scale == 1.0
    assert rehearsal.settings.camera.fps == 30.0
    with Camera(rehearsal.settings.camera) as camera:
        frames = camera.fresh(time.monotonic_ns(), 12)
        assert np.array_equal(frames[-1].image, rehearsal.emulation.image(frames[-1].t_ns))
        assert camera.period_s == pytest.approx(1 / 30, rel=0.25)


def test_the_truth_is_told(rehearsal: Rehearsal) -> None:
    emulation = rehearsal.emulation
    assert emulation.tool()[:3] == pytest.approx((0.0, 0.0, -48.0))
    assert emulation.truth().depth_mm < 0
    emulation.keep_to(rehearsal.settings.envelope)
    assert (emulation.presses(), emulation.outside()) == (0, [])
    emulation.arm(Fault("pin-loss"))
    assert [event.handled for event in emulation.fired()] == [True]
    emulation.repair()
    emulation.mount(Indenter.dual(8.0))


def test_what_goes_wrong_there_is_raised_here() -> None:
    with (
        pytest.raises(UserError, match="unknown sensor 'none'"),
        rehearse(make_settings(), sensor="none"),
    ):
        pytest.fail("it was built")


def test_it_ends_with_whoever_started_it_even_by_a_kill() -> None:
    code = (
        "import sys\n"
        "sys.path.insert(0, 'tests/shared')\n"
        "from emulated import GraySensor\n"
        "from fake_station import make_settings\n"
        "from tactibench_tactip.emulators import rehearse\n"
        "if __name__ == '__main__':\n"
        "    with rehearse(make_settings(), sensor=GraySensor()) as r:\n"
        "        import multiprocessing\n"
        "        print(multiprocessing.active_children()[0].pid, flush=True)\n"
        "        r.emulation.tool()\n"
        "        sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.send_signal(signal.SIGKILL)
        parent.wait(10)
        end = time.monotonic() + 10
        while _runs(child):
            assert time.monotonic() < end, "it outlived its parent"
            time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
