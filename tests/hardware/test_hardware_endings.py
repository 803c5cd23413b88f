"""A process that has a camera's stream open ends with its own exit code, however it ends.

OpenCV aborts a process (exit code 134) whose camera is still read when Python ends.
"""

from __future__ import annotations

import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mjpeg_rig import MjpegCamera, interrupt, run_hw, write_configuration

from tactibench.datasets import open_dataset

pytestmark = pytest.mark.long


@pytest.fixture
def camera() -> Iterator[MjpegCamera]:
    with MjpegCamera() as camera:
        yield camera


@pytest.fixture
def config(camera: MjpegCamera, tmp_path: Path) -> str:
    return str(write_configuration(tmp_path, camera.url))


def collect(folder: Path, config: str, presses: int = 6) -> tuple[str, ...]:
    """The arguments of a collection of single presses."""
    plan = folder / "plan.jsonl"
    plan.write_text("\n".join(PLAN_ROW.format(id=k) for k in range(presses)))
    return ("collect", str(plan), "--config", config, "--out", str(folder / "data"))


def rows_written(folder: Path, count: int) -> None:
    """Wait until so many samples are written."""
    journal, end = folder / "data" / "metadata.jsonl", time.monotonic() + 60.0
    while time.monotonic() < end:
        if journal.exists() and len(journal.read_bytes().splitlines()) >= count:
            return
        time.sleep(0.02)


def test_an_error(config: str, tmp_path: Path) -> None:
    path = Path(config)
    path.write_text(path.read_text().replace("warmup", "crop = [0, 0, 65, 64]\nwarmup"))
    code, _, error = run_hw(*collect(tmp_path, config))
    assert code == 2
    assert "camera.crop reaches to 65 x 64 px" in error


@pytest.mark.parametrize("again_s", [(), (0.1,)])
def test_control_c(config: str, tmp_path: Path, again_s: tuple[float, ...]) -> None:
    def press(process: subprocess.Popen[str]) -> None:
        rows_written(tmp_path, 1)
        interrupt(process, 0.0, *again_s)

    code, _, error = run_hw(*collect(tmp_path, config, 40), meanwhile=press)
    assert code == 130
    assert "terminate" not in error


PLAN_ROW = (
    '{{"id": {id}, "indenter": "single", "indenter_radius_mm": 3.0, "x_mm": 0.0, "y_mm": 0.0, '
    '"depth_mm": 1.5}}'
)


@pytest.mark.parametrize(("fault", "end"), [("cut", 2), ("kill", -signal.SIGKILL)])
def test_a_camera_that_is_cut_or_a_process_that_is_killed_loses_no_press(
    camera: MjpegCamera, config: str, tmp_path: Path, fault: str, end: int
) -> None:
    """There is no bad row, and the next session makes what is missing."""
    data, arguments = tmp_path / "data", collect(tmp_path, config)

    def strike(process: subprocess.Popen[str]) -> None:
        rows_written(tmp_path, 2)
        if fault == "cut":
            camera.cut.set()
        else:
            process.kill()

    code, _, error = run_hw(*arguments, meanwhile=strike)
    assert code == end
    assert fault == "kill" or "camera" in error
    written = [sample.status for sample in open_dataset(data).samples]
    assert 2 <= len(written) < 6
    assert set(written) == {"ok"}
    camera.cut.clear()
    code, out, _ = run_hw(*arguments)
    assert code == 0
    assert "good and 0 bad samples" in out
    assert sorted(sample.id for sample in open_dataset(data).samples) == list(range(6))


@pytest.mark.parametrize(
    ("fault", "value", "late", "told"),
    [
        ("frozen", True, False, "is frozen: it repeats frames"),
        ("frozen", True, True, "is frozen: it repeats frames"),
        ("lag_s", 0.3, False, r"showed 0\.[34]\d s after first touch, camera.lag_s allows 0.1"),
        ("side", 48, True, "frames of 48 x 48 px, not of 64 x 64 px as before"),
        ("fps", 8.0, True, r"sends \d+\.\d new frames a second, camera.fps is 30"),
    ],
)
def test_a_stream_that_is_not_what_it_was_or_not_in_time(
    camera: MjpegCamera,
    config: str,
    tmp_path: Path,
    fault: str,
    value: object,
    late: bool,
    told: str,
) -> None:
    """OpenCV alone would scale frames of another size to that of the first one."""

    def begin(_: object = None) -> None:
        if late:
            rows_written(tmp_path, 2)
        if fault == "frozen":
            camera.frozen.set()
        else:
            setattr(camera, fault, value)

    if not late:
        begin()
    arguments = collect(tmp_path, config, 20)
    code, _, error = run_hw(*arguments, meanwhile=begin if late else lambda _: None)
    assert code == 2
    assert re.search(told, error)
    data = tmp_path / "data"
    written = [sample.status for sample in open_dataset(data).samples] if data.exists() else []
    assert set(written) == ({"ok"} if late else set())


@pytest.mark.parametrize("fps", [30.0, 8.0])
def test_doctor_tells_the_rate_of_the_stream(camera: MjpegCamera, config: str, fps: float) -> None:
    """Frames that waited in a buffer come all at once; they say nothing of the rate."""
    camera.fps = fps
    code, out, _ = run_hw("doctor", "--config", config)
    assert code == (fps < 30.0)
    told = (
        r"WRONG  camera +the camera sends ([\d.]+) new"
        if code
        else r"ok +frames +([\d.]+) a second"
    )
    rate = re.search(told, out)
    assert rate is not None
    assert float(rate[1]) == pytest.approx(fps, rel=0.2)
