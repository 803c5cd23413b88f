"""Collect for eight simulated hours, with a fault every ten minutes.

    python benchmarks/hardware_day.py [--hours 8] [--seed 0] [--minutes 10]

Faults are of the camera, the robot, the disk or a person. Robot, camera and clock are those of
``tests/shared/virtual_lab.py``: nothing sleeps, and an hour takes about a minute of a processor. A
fault begins at a random moment of its ten minutes, or when the fault before is put right; one that
needs a moving tool or a running session waits for it. It stays until the session ends; then a
person puts it right and gives the same command again. Prints a row for each kind of fault: how
often it came, how often the sentence or the journal named it, and how often the tool was left where
it was.

Exit code 1 where the arm did what it must not (moved sideways below clearance, or more than 0.5 mm
deeper than planned), a sample was lost or made twice, a good sample shows another depth than its
label, or a fault was not named or never came.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from virtual_lab import VirtualLab

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import open_dataset, verify
from tactibench.lab import Press
from tactibench_tactip import CollectionPlan, matrix

RATE = "new frames a second"
CAMERA = {
    "freeze": "is frozen",
    "ring": "is frozen",
    "double": RATE,
    "slow": RATE,
    "half": RATE,
    "shrink": "frames of 32 x 32 px",
    **dict.fromkeys(("mirror", "dark", "bright"), "the light or the exposure changed"),
    "hang": "gave no frame",
    "cut": "sends no more frames",
}
"""Fault of ``VirtualCapture`` -> part of the sentence that names it."""
REPAIR_S = 60.0
"""Time in which a person puts a fault right."""


class Day:
    """The lab, its faults, and what is wrong at any time.

    Attributes:
        fault: Name of the present fault; "" where all is well.
        named_by: Part of the sentence that names it.
        full: Whether the disk is full.
        came, named, left: Fault -> how often it came, was named, and left the tool where it was.
        surprises: Sentences about what should not have been.
    """

    def __init__(self, lab: VirtualLab, rng: np.random.Generator) -> None:
        self.lab, self.rng = lab, rng
        self.fault, self.named_by, self.full = "", "", False
        self.came, self.named, self.left = Counter[str](), Counter[str](), Counter[str]()
        self.surprises: list[str] = []
        self.faults: dict[str, tuple[str, Callable[[], None]]] = {
            **{
                f"camera: {name}": (said, partial(setattr, lab.capture, "fault", name))
                for name, said in CAMERA.items()
            },
            "camera: lag": ("the camera lags", self._lag),
            "robot: protective stop": ("the robot is not normal", self._protect),
            "robot: held on its way down": ("held it", partial(self._grip, False)),
            "robot: held on its way back": ("held it", partial(self._grip, True)),
            "robot: link lost": ("the link is gone", self._lose),
            "robot: alarm in contact": ("is not known: alarm 1", partial(self._alarm, False)),
            "robot: alarm on its way back": ("is not known: alarm 1", partial(self._alarm, True)),
            "robot: force": ("the force changed", self._push),
            "disk: full": ("No space left", lambda: setattr(self, "full", True)),
            "person: Ctrl-C": ("interrupted", partial(self._signal, signal.SIGINT)),
            "person: SIGTERM": ("interrupted", partial(self._signal, signal.SIGTERM)),
        }

    @property
    def is_collecting(self) -> bool:
        """Whether a session runs that handles signals, as it does before anything moves."""
        return signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL

    def _when(self, is_time: Callable[[], bool], act: Callable[[], None]) -> None:
        """Act at the first moment of this fault that is one for it."""
        if is_time():
            act()
        elif self.fault:
            self.lab.later(0.04, partial(self._when, is_time, act))

    def _moves(self, out: bool) -> bool:
        """Whether the tool moves in contact, out of it or into it, since 0.05 s, for 0.1 s more.

        One that is stopped at its first step is sent once more, one at its last has arrived.
        """
        robot = self.lab.robot
        began, ended, start, end = robot.way[-1]
        goes_out = (robot.from_base @ matrix(end))[2, 3] < (robot.from_base @ matrix(start))[2, 3]
        moves = began + 0.05 <= self.lab.clock.now_s < ended - 0.1
        return bool(moves and robot.depth() > 0.3 and goes_out == out)

    def _grip(self, out: bool) -> None:
        self._when(partial(self._moves, out), lambda: self.lab.robot.stop())

    def _alarm(self, out: bool) -> None:
        def stop() -> None:
            self.lab.robot.stop()
            self.lab.robot.unknown = "alarm 1: a limit switch was hit"

        self._when(partial(self._moves, out), stop)

    def _protect(self) -> None:
        self._when(lambda: self.is_collecting, lambda: self.lab.robot.protect())

    def _lose(self) -> None:
        self._when(lambda: self.is_collecting, lambda: setattr(self.lab.robot, "lost", True))

    def _signal(self, number: int) -> None:
        self._when(lambda: self.is_collecting, partial(signal.raise_signal, number))

    def _lag(self) -> None:
        self.lab.capture.lag_s = float(self.rng.uniform(0.25, 1.5))

    def _push(self) -> None:
        """Let something be in the way until a press is tried again, or the session ends."""
        self.lab.robot.resist(60.0)
        self.lab.later(0.5, self._calm)

    def _calm(self) -> None:
        if self.fault != "robot: force":
            return
        if self.named_by in (self.lab.folder / "events.jsonl").read_text().splitlines()[-1]:
            self.lab.robot.resist(None)
            self.count("")
            self.fault = ""
        else:
            self.lab.later(0.5, self._calm)

    def count(self, said: str) -> None:
        """Count the present fault, and whether the sentence or the journal named it."""
        events = open_dataset(self.lab.folder).events[-9:]
        is_named = any(self.named_by in text for text in (said, *map(str, events)))
        self.came[self.fault] += 1
        self.named[self.fault] += is_named
        self.left[self.fault] += "left where it is" in said
        if not is_named:
            self.surprises.append(f"{self.fault}: {said}")

    def begin(self, name: str) -> None:
        """Let a fault begin, as soon as the one before is put right and a session runs."""
        if self.fault or not self.is_collecting:
            self.lab.later(5.0, partial(self.begin, name))
            return
        self.fault, (self.named_by, begin) = name, self.faults[name]
        begin()

    def end(self) -> None:
        """Go home."""
        if self.is_collecting:
            signal.raise_signal(signal.SIGINT)
        else:
            self.lab.later(5.0, self.end)

    def repair(self) -> None:
        """Put everything right."""
        self.lab.clock.sleep(REPAIR_S)
        self.fault, self.full = "", False
        self.lab.capture.fault, self.lab.capture.lag_s = "", 0.0


def plan(count: int, rng: np.random.Generator) -> CollectionPlan:
    """Return presses of random places and depths."""
    return CollectionPlan(
        "day",
        tuple(
            Press(k, f"p{k}", Scene(Indenter.single(), Pose(x, y, depth=depth)), "singles")
            for k, (x, y, depth) in enumerate(rng.uniform((-3, -3, 0.2), (3, 3, 4.5), (count, 3)))
        ),
        {},
    )


def run(hours: float, minutes: float, seed: int, folder: Path) -> int:
    """Run the day and print the table; return the exit code."""
    rng, began_s = np.random.default_rng(seed), time.perf_counter()
    with pytest.MonkeyPatch.context() as patch:
        presses = plan(int(3600 * hours / 5) + 10, rng)
        lab = VirtualLab(
            folder, patch, presses, contact={"method": "visual"}, timing={"settle_s": 2.0}
        )
        day = Day(lab, rng)
        _fill_disk(day, patch)
        names = list(day.faults)
        order = [str(name) for _ in range(99) for name in rng.permutation(names)]
        faults = int(60 * hours / minutes)
        for k in range(faults):
            at_s = 60.0 * minutes * (k + float(rng.uniform(0.05, 0.95)))
            lab.later(at_s, partial(day.begin, order[k]))
        begin_s, surprises = lab.clock.now_s, day.surprises
        acknowledged: set[int] = set()
        lab.later(3600.0 * hours, day.end)
        while lab.clock.now_s - begin_s < 3600.0 * hours:
            session = lab.session()
            ended = session.report is not None and not session.report.interrupted
            said = session.said or ("done" if ended else "interrupted")
            ids = {sample.id for sample in lab.samples()}
            if not acknowledged <= ids:
                surprises.append(f"lost: {sorted(acknowledged - ids)}")
            acknowledged = ids
            hour, faulty = (lab.clock.now_s - begin_s) / 3600.0, day.fault or "no fault"
            print(f"{hour:.2f} h, {len(ids)} samples, {faulty}: {said}", file=sys.stderr)
            if day.fault:
                day.count(said)
            elif said not in ("done", "interrupted"):
                surprises.append(f"without a fault: {said}")
            if said == "done":
                break
            day.repair()
        came, named = sum(day.came.values()), sum(day.named.values())
        for name in sorted(day.came):
            print(
                f"{name:<28} came {day.came[name]:>3}  named {day.named[name]:>3}  "
                f"left {day.left[name]:>3}"
            )
        samples = lab.samples()
        double = len(samples) - len({sample.id for sample in samples})
        wrong, unsafe, damage = lab.wrong_samples(), lab.unsafe(), verify(folder)
        count = Counter(sample.status for sample in samples)
        print(
            f"{(lab.clock.now_s - begin_s) / 3600:.1f} h in "
            f"{(time.perf_counter() - began_s) / 60:.0f} min, {came} of {faults} faults, "
            f"{len(lab.robot.moves_made)} moves, {count['ok']} good and {count['bad']} bad samples"
        )
        print(
            f"unsafe {len(unsafe)}, lost or double {double + len(damage)}, wrong and good "
            f"{len(wrong)}, not named {came - named}"
        )
        for line in [*surprises, *unsafe[:9], *map(str, wrong[:9])]:
            print(line)
    return int(bool(surprises or unsafe or wrong or damage or double or came < faults))


def _fill_disk(day: Day, patch: pytest.MonkeyPatch) -> None:
    from tactibench.datasets import Writer

    write = Writer.add_many

    def add_many(writer: Writer, drafts: object) -> object:
        if day.full:
            raise OSError(28, "No space left on device")
        return write(writer, drafts)  # type: ignore[arg-type]

    patch.setattr(Writer, "add_many", add_many)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", 1)[0])
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        return run(options.hours, options.minutes, options.seed, Path(folder) / "data")


if __name__ == "__main__":
    sys.exit(main())
