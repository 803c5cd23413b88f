"""Make a whole collection on the emulators and score it against their truth.

    python benchmarks/hardware.py collect --driver grbl --presses 500       labels, freshness, speed
    python benchmarks/hardware.py collect --protocol exp2 --draw pairs --presses 10 --driver ur
    python benchmarks/hardware.py collect --presses 5000 --time-scale 200 --fps 240         memory
    python benchmarks/hardware.py faults                                    what every fault does
    python benchmarks/hardware.py kills --kills 50                          SIGKILL of the collector

Sensor, robot and camera are emulated on this machine; the times printed are this machine's.
``kills`` starts the command line again and again, kills it, and checks the ids in the data set.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from hardware_kills import run_kills

from tactibench import UserError
from tactibench.datasets import images, open_dataset
from tactibench_tactip.collection import collect
from tactibench_tactip.collector import Callbacks
from tactibench_tactip.emulators import Emulation, Fault, HiddenOffset, Rehearsal, rehearse
from tactibench_tactip.plan import plan_of
from tactibench_tactip.robots.ur import Dashboard
from tactibench_tactip.settings import Settings, example_configuration

UR_FAULTS = (
    "protective-stop",
    "unlock-refused",
    "emergency-stop",
    "socket-drop",
    "frozen-stream",
    "wrong-length",
    "program-stop",
)
GRBL_FAULTS = (
    "alarm-1",
    "alarm-2",
    "alarm-3",
    "alarm-5",
    "no-ok",
    "garbled-line",
    "unplug",
    "hold",
)
CAMERA_FAULTS = (
    "camera-stall",
    "camera-drop",
    "stale-frames",
    "black-frames",
    "brightness-jump",
    "pin-loss",
)
VALUES = {
    "camera-stall": 60.0,
    "frozen-stream": 60.0,
    "stale-frames": 40.0,
    "black-frames": 40.0,
    "pin-loss": 5.0,
    "alarm-5": 50.0,
}
"""Values of the faults: seconds of the world's clock, pins or probes. A stall is longer than a
deadline at a time scale of 20."""
DISK_FULL = "disk-full"
ALIKE = 3.0
"""Mean difference, grey levels, up to which a kept frame counts as the true image of its time: a
frame of another moment differs by more than the camera's noise."""


def settings_of(driver: str, **contact: Any) -> Settings:
    tables = tomllib.loads(example_configuration(driver))
    tables["contact"] |= contact
    tables["camera"] = {"source": "emulated", "warmup_frames": 5}
    return Settings.model_validate(tables)


class Frames:
    """Errors of the kept frames and labels, looked up while the emulated world still knows them.

    Attributes:
        off: Mean difference of each kept frame from the true image, grey levels.
        depth: Error of each depth label, mm.
        place: Error of each position label, mm.
        late_ms: Time from the end of settling to each frame, ms.
    """

    def __init__(self, emulation: Emulation, folder: Path) -> None:
        self._emulation, self._folder = emulation, folder
        self._seen = 0
        self.off: list[float] = []
        self.depth: list[float] = []
        self.place: list[float] = []
        self.late_ms: list[float] = []

    def look(self) -> None:
        """Score the frames that were written since the last call."""
        lines = (self._folder / "metadata.jsonl").read_bytes().splitlines()
        for line in lines[self._seen :]:
            row = json.loads(line)
            self._seen += 1
            if row["status"] != "ok":
                continue
            at_ns = row["t_frame_ns"]
            kept = cv2.imread(str(self._folder / row["file_name"]), cv2.IMREAD_GRAYSCALE)
            assert kept is not None  # noqa: S101 - the collector wrote it
            self.off.append(float(np.abs(kept.astype(float) - self._emulation.image(at_ns)).mean()))
            truth = self._emulation.truth(at_ns).contacts
            label_xy = np.array(row["contacts_xy_mm"])
            for xy, depth in zip(truth.xy, truth.depth, strict=True):
                away = np.hypot(*(label_xy - xy).T)
                nearest = int(away.argmin())
                self.place.append(float(away[nearest]))
                self.depth.append(row["contacts_depth_mm"][nearest] - float(depth))
            self.late_ms.append((at_ns - row["extra"]["t_settle_ns"]) * 1e-6)

    @property
    def stale(self) -> int:
        """Number of frames that were taken before the end of settling, or show another moment."""
        pairs = zip(self.late_ms, self.off, strict=True)
        return sum(late <= 0 or off > ALIKE for late, off in pairs)


def run_collect(arguments: argparse.Namespace) -> None:
    folder = Path(arguments.out or tempfile.mkdtemp(prefix="tactibench-hw-"))
    settings = settings_of(arguments.driver)
    plan = plan_of(arguments.protocol, settings, draws=arguments.draw, count=arguments.presses)
    given = {"time_scale": arguments.time_scale, "fps": arguments.fps}
    with rehearse(settings, hidden=HiddenOffset(z=0.8), **given) as rehearsal:
        emulation = rehearsal.emulation
        frames = Frames(emulation, folder)
        start, done, early = time.monotonic(), 0, 0.0

        def advance(count: int) -> None:
            nonlocal done, early
            done += count
            frames.look()
            if done <= max(1, len(plan) // 10):
                early = _peak()
            if done % 100 == 0:
                print(f"  {done} of {len(plan)}, {time.monotonic() - start:.0f} s", flush=True)

        def mount(indenter: Any, _count: int) -> bool:
            emulation.mount(indenter)
            return True

        report = collect(
            rehearsal.settings,
            plan,
            folder,
            callbacks=Callbacks(print, advance, mount=mount),
            on_station=lambda _: emulation.keep_to(settings.envelope),
        )
        took = time.monotonic() - start
        outside = len(emulation.outside())
    depth, place = np.abs(frames.depth), np.array(frames.place)
    print(
        f"{arguments.protocol} on {arguments.driver}, time scale {arguments.time_scale:g}: "
        f"{report.ok} ok, {report.bad} bad, {report.left} left in {took:.0f} s "
        f"({took / max(1, report.ok):.2f} s a press)"
    )
    print(
        f"depth label against truth: mean {np.mean(frames.depth):+.4f}, worst "
        f"{depth.max():.4f} mm ({len(depth)} contacts)"
    )
    print(f"position label against truth: worst {place.max():.5f} mm")
    print(
        f"frames: {min(frames.late_ms):.1f} ms after the end of settling at least, at most "
        f"{max(frames.off):.2f} grey levels from the truth; {frames.stale} stale"
    )
    print(f"first touch: {[round(touch.z0_mm, 4) for touch in report.touches]}, true 0.8 mm")
    print(f"motion outside the envelope: {outside} times")
    print(
        f"peak memory: {early:.0f} MiB after a tenth of the presses, {_peak():.0f} MiB in the end"
    )
    print(f"data set: {folder}")


def _peak() -> float:
    """Return the peak memory of this process, MiB: the collector and the data of this benchmark."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run_faults(arguments: argparse.Namespace) -> None:
    """Cause every fault at the fourth press of six, and call again until all presses are there."""
    base = Path(tempfile.mkdtemp(prefix="tactibench-faults-"))
    wanted = [("grbl", kind) for kind in (*GRBL_FAULTS, *CAMERA_FAULTS, DISK_FULL)]
    wanted += [("ur", kind) for kind in (*UR_FAULTS, *CAMERA_FAULTS, DISK_FULL)]
    if arguments.only:
        wanted = [pair for pair in wanted if pair[1] in arguments.only]
    print(
        "robot fault            sessions  ok  bad  ids  stale  longest s  outside  "
        "first session ended by"
    )
    for driver, kind in wanted:
        print(_one_fault(driver, kind, base / f"{driver}-{kind}"), flush=True)
    shutil.rmtree(base, ignore_errors=True)


def _one_fault(driver: str, kind: str, folder: Path) -> str:
    settings = settings_of(driver, **({"method": "probe"} if kind == "alarm-5" else {}))
    plan = plan_of("exp1", settings, draws=("singles",), count=6)
    ended, longest, sessions = "", 0.0, 0
    given = {"time_scale": 20.0, "fps": 60.0, "faults": _faults(kind)}
    with rehearse(settings, **given) as rehearsal, _disk(kind) as disk:
        emulation = rehearsal.emulation
        if kind == "alarm-5":  # first touch is searched before any press
            emulation.arm(Fault(kind, value=VALUES[kind]))
        frames = Frames(emulation, folder)
        for sessions in range(1, 6):  # noqa: B007
            start = time.monotonic()
            try:
                report = collect(
                    rehearsal.settings,
                    plan,
                    folder,
                    callbacks=Callbacks(advance=lambda _: frames.look()),
                    on_station=lambda _: emulation.keep_to(settings.envelope),
                )
                longest = max(longest, time.monotonic() - start)
                if not report.left:
                    break
            except (UserError, OSError) as error:
                longest = max(longest, time.monotonic() - start)
                ended = ended or str(error)
                _repair(rehearsal, kind)
            finally:
                emulation.keep_to(None)
        outside = len(emulation.outside())
        happened = emulation.fired()
        fired = disk.full or (happened and all(event.handled for event in happened))
    samples = open_dataset(folder).samples
    ok = sum(sample.status == "ok" for sample in samples)
    complete = sorted(sample.id for sample in samples) == sorted(press.id for press in plan.presses)
    return (
        f"{driver:<5} {kind:<16} {sessions:>8} {ok:>4} {len(samples) - ok:>4}  "
        f"{'all ' if complete else 'LOST'} {frames.stale:>6} {longest:>10.1f} {outside:>8}  "
        f"{'' if fired else 'NOT FIRED '}{ended[:90]}"
    )


def _faults(kind: str) -> tuple[Fault, ...]:
    if kind in (DISK_FULL, "alarm-5"):
        return ()
    faults = [Fault(kind, press=4, value=VALUES.get(kind))]
    if kind == "unlock-refused":
        faults.append(Fault("protective-stop", press=4))
    return tuple(faults)


class _Disk:
    """A writer of images for which the disk is full once, at the fourth press."""

    def __init__(self, write: Callable[[Path, bytes], None]) -> None:
        self._write, self._count, self.full = write, 0, False

    def __call__(self, path: Path, data: bytes) -> None:
        self._count += 1
        if self._count == 5:  # the first is the undeformed sensor's
            self.full = True
            raise OSError(28, "No space left on device")
        self._write(path, data)


@contextmanager
def _disk(kind: str) -> Iterator[_Disk]:
    disk = _Disk(images.write_file)
    if kind != DISK_FULL:
        yield disk
        return
    with mock.patch.object(images, "write_file", disk):
        yield disk


def _repair(rehearsal: Rehearsal, kind: str) -> None:
    """Repair the devices as a person would do before the next session."""
    rehearsal.emulation.repair()
    if kind in ("protective-stop", "unlock-refused"):
        board = Dashboard(rehearsal.settings.robot.address)
        for _ in range(40):
            board.ask("unlock protective stop")
            if "NORMAL" in board.ask("safetystatus"):
                break
            time.sleep(0.1)
        board.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    collecting = verbs.add_parser("collect")
    collecting.add_argument("--protocol", default="exp1")
    collecting.add_argument("--draw", action="append", default=None)
    collecting.add_argument("--driver", choices=("ur", "grbl"), default="grbl")
    collecting.add_argument("--presses", type=int, default=500)
    collecting.add_argument("--time-scale", type=float, default=20.0)
    collecting.add_argument("--fps", type=float, default=60.0)
    collecting.add_argument("--out")
    faults = verbs.add_parser("faults")
    faults.add_argument("--only", nargs="*")
    kills = verbs.add_parser("kills")
    kills.add_argument("--kills", type=int, default=50)
    kills.add_argument("--presses", type=int, default=150)
    kills.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.verb == "collect":
        arguments.draw = arguments.draw or (
            ["singles"] if arguments.protocol == "exp1" else ["pairs"]
        )
    if arguments.verb == "kills":
        run_kills(arguments.kills, arguments.presses, arguments.seed, settings_of("grbl"))
    else:
        {"collect": run_collect, "faults": run_faults}[arguments.verb](arguments)


if __name__ == "__main__":
    main()
