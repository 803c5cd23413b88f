"""Whole commands against devices in another process, at 30 frames/s, as fast as time runs.

The arm is reached by ur_rtde, the stage over a pseudo-terminal, the camera by OpenCV. Every case
says how the process ends and what it prints; no sample that was written is lost, and what is
missing is made by the next session.
"""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rehearsal_rig import Lab, lab, wait_for_rows, write_plan

from tactibench.datasets import open_dataset, verify
from tactibench_tactip.emulators import Fault

pytestmark = pytest.mark.slow  # real speed: a quarter of an hour for all
pytest.importorskip("rtde_control", reason="the arm's client is in the extra hardware")

PRESSES = 4
Happening = Callable[[Lab, subprocess.Popen[str]], object]


@pytest.fixture
def devices(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Lab]:
    with lab(tmp_path, request.param) as running:
        yield running


def fault(kind: str, value: float | None = None) -> Happening:
    return lambda devices, _: devices.emulation.arm(Fault(kind, value=value))


def keys(*pauses_s: float) -> Happening:
    """Ctrl-C, again after so many seconds."""

    def press(_: Lab, process: subprocess.Popen[str]) -> None:
        for seconds in (0.0, *pauses_s):
            time.sleep(seconds)
            process.send_signal(signal.SIGINT)

    return press


def kill(_: Lab, process: subprocess.Popen[str]) -> None:
    process.kill()


def nothing(_: Lab, __: subprocess.Popen[str]) -> None:
    """All goes well."""


@pytest.mark.parametrize(
    ("devices", "arguments", "code", "words"),
    [
        ("ur", ("doctor",), 0, "a second"),
        ("grbl", ("doctor",), 0, "each command that moves it homes it first"),
        ("grbl", ("jog",), 2, "the stage is not homed"),  # nothing may move
        ("ur", ("settle-test", "--seconds", "3"), 0, "still within noise"),
        ("grbl", ("settle-test", "--seconds", "3"), 0, "still within noise"),
        ("ur", ("jog", "--by", "1", "0", "0", "--yes"), 0, "mm"),
        ("grbl", ("jog", "--home", "--yes"), 0, "mm"),
        (
            "grbl",
            ("jog", "--by", "1", "0", "0", "--yes"),
            2,
            "nothing was moved",
        ),  # at its switches
        ("ur", ("calibrate", "--points", "4"), 0, "sensor"),
        ("grbl", ("calibrate", "--points", "4"), 0, "sensor"),
    ],
    indirect=["devices"],
)
def test_a_command_ends_well(
    devices: Lab, arguments: tuple[str, ...], code: int, words: str
) -> None:
    found, printed = devices.hw(*arguments)
    assert found == code, printed
    assert words in printed


@pytest.mark.parametrize(
    ("devices", "arguments", "happens", "code", "words"),
    [
        ("ur", ("settle-test", "--seconds", "30"), keys(), 130, ""),
        ("grbl", ("settle-test", "--seconds", "30"), keys(0.2), 130, ""),
        ("ur", ("settle-test", "--seconds", "30"), fault("camera-stall"), 2, "camera"),
        ("ur", ("calibrate", "--points", "4"), fault("protective-stop"), 2, "protective stop"),
        ("grbl", ("calibrate", "--points", "4"), fault("unplug"), 2, "stage"),
    ],
    indirect=["devices"],
)
def test_a_command_that_is_disturbed_says_so(
    devices: Lab, arguments: tuple[str, ...], happens: Happening, code: int, words: str
) -> None:
    def disturb(process: subprocess.Popen[str]) -> None:
        end = time.monotonic() + 60.0
        while devices.emulation.presses() < 1 and time.monotonic() < end:
            time.sleep(0.05)
        happens(devices, process)

    found, printed = devices.hw(*arguments, meanwhile=disturb)
    assert found == code, printed
    assert words in printed
    assert "Traceback" not in printed


@pytest.mark.parametrize(
    ("devices", "happens", "codes", "words"),
    [
        ("ur", nothing, (0,), "4 good and 0 bad"),
        ("grbl", nothing, (0,), "4 good and 0 bad"),
        ("ur", keys(), (130,), "again"),
        ("grbl", keys(), (130,), "again"),
        ("ur", keys(0.3), (130,), ""),
        # On a busy machine the arm's watchdog is first.
        ("ur", fault("camera-stall", 20.0), (2,), ""),
        ("grbl", fault("camera-stall", 20.0), (2,), "camera"),
        ("grbl", fault("unplug"), (2,), ""),
        # The link is made again, unless the control program has ended before: told, nothing lost.
        ("ur", fault("socket-drop"), (0, 2), ""),
        ("ur", fault("emergency-stop"), (2,), "emergency"),
        ("ur", kill, (-9,), ""),
        ("grbl", kill, (-9,), ""),
    ],
    indirect=["devices"],
)
def test_a_collection_loses_nothing(
    devices: Lab, happens: Happening, codes: tuple[int, ...], words: str
) -> None:
    plan, data = write_plan(devices.folder, PRESSES), devices.folder / "data"
    journal = data / "metadata.jsonl"
    before: list[bytes] = []

    def disturb(process: subprocess.Popen[str]) -> None:
        wait_for_rows(journal, 1)
        before.extend(journal.read_bytes().splitlines(keepends=True))
        happens(devices, process)

    arguments = ("collect", str(plan), "--out", str(data))
    found, printed = devices.hw(*arguments, meanwhile=disturb)
    assert found in codes, printed
    assert words in printed
    assert "Traceback" not in printed
    if found != 0:
        devices.emulation.repair()
        time.sleep(20.0 if happens is not kill and found == 2 else 0.0)  # a stalled camera goes on
        again, printed = devices.hw(*arguments)
        assert again == 0, printed
    whole = [line for line in before if line.endswith(b"\n")]
    assert journal.read_bytes().splitlines(keepends=True)[: len(whole)] == whole
    samples = open_dataset(data).samples
    assert sorted(s.id for s in samples if s.status == "ok") == list(range(PRESSES))
    assert verify(data) == []


@pytest.mark.parametrize("devices", ["ur"], indirect=True)
def test_a_full_disk_is_called_full(devices: Lab) -> None:
    plan, data = write_plan(devices.folder, PRESSES), devices.folder / "data"
    arguments = ("collect", str(plan), "--out", str(data))
    found, printed = devices.hw(*arguments, largest_file=4000)
    assert found == 2, printed
    assert "cannot be written" in printed or "large" in printed or "full" in printed
    found, printed = devices.hw(*arguments)
    assert found == 0, printed
    assert verify(data) == []
