"""Stages of the work, each stopped at some moment, called again and compared with undisturbed ones.

A stage is a command, the commands that must have been there before it, and what its outcome is: its
record without times and dates. Stopped: SIGKILL at a random moment or before any operation that
changes the file system, or a disk that is full from that operation on.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tiny_lab import Lab

RUN = ("run", "exp1", "--model", "tiny")
CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.chmod"}
GROWS = {"os.mkdir", "os.rename", "fsync", "open"}
"""Operations that a full disk refuses; things can still be removed."""
UNTIMED = ("created", "environment", "speed", "timed", "efficiency")
OUTCOMES = ("right", "named", "lost", "twice", "hung", "silent")


@dataclass(frozen=True)
class Stage:
    name: str
    command: tuple[str, ...]
    before: tuple[tuple[str, ...], ...]
    outcome: Callable[[Path], Any]


def _sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _files(folder: Path) -> dict[str, str]:
    """Every visible file with its hash."""
    found = (p for p in sorted(folder.rglob("*")) if p.is_file())
    inside = ((p.relative_to(folder), p) for p in found)
    return {
        str(name): _sha(p)
        for name, p in inside
        if not any(part.startswith(".") for part in name.parts)
    }


def _data_set(folder: Path) -> Any:
    """Of every sample all but when it was taken; the files, verified."""
    from tactibench.datasets import open_dataset, verify

    path = folder / "set"
    data = open_dataset(path)
    samples = [(s.id, s.sha256, s.scene) for s in data.samples]
    return verify(path), data.header.status, samples, _files(path / "images")


def _weights(folder: Path) -> Any:
    """The weights and the frames they were learned from; nothing half done beside them."""
    cache = folder / "cache"
    manifests = [json.loads(p.read_text()) for p in sorted(cache.glob("weights/*/manifest.json"))]
    frames = {n: h for n, h in _files(cache / "frames").items() if n.endswith(".npy")}
    left = [
        p.name
        for kind in ("weights", "frames")
        for p in (cache / kind).iterdir()
        if p.suffix in {".made", ".parts"}
    ]
    return [(m["identity"], m["files"], m["hash"]) for m in manifests], frames, left


def _runs(folder: Path) -> Any:
    """Every stored run that can be opened, its arrays verified; times left out."""
    from tactibench.records import PARTS, stored_runs

    found = {}
    for run in stored_runs(folder / "runs"):
        for part in PARTS:
            run.arrays(part)
        record = {k: v for k, v in run.record.json_values().items() if k not in UNTIMED}
        training = {k: v for k, v in record["training"].items() if k in ("epochs", "presses")}
        stored = {k: v for k, v in record["identity"]["stored"].items() if k != "times"}
        identity = {**record["identity"], "stored": stored, "sealed": ""}
        found[run.folder.name] = {**record, "training": training, "identity": identity}
    return found


def _scored(folder: Path) -> Any:
    return json.loads((folder / "scored.json").read_text()), _runs(folder), _files(folder / "runs")


def _board(folder: Path) -> Any:
    return _files(folder / "leaderboards"), _files(folder / "runs")


def _visible(folder: Path) -> Any:
    """All that a command left in its folder but what it printed, of dated pages the name."""
    kept = _files(folder)
    return {
        name: value
        for name, value in kept.items()
        if not name.startswith(("cache/", "output.txt")) and not name.endswith((".json", ".html"))
    } | {name: "" for name in kept if name.endswith((".json", ".html"))}


TRAIN = ("run", "exp1", "--model", "tiny", "--train-only")
GENERATE = ("data", "generate", "exp1", "--count", "8", "--out", "set")
BOARD = ("board", "add", "exp1-*")
STAGES = (
    Stage("generate", GENERATE, (), _data_set),
    Stage("new", ("new", "model", "mine"), (), _visible),
    Stage("train", TRAIN, (), _weights),
    Stage("predict", RUN, (TRAIN,), _runs),
    Stage("replace", (*RUN, "--fresh"), (RUN,), _runs),
    Stage("score", ("score", "RUN", "--json", "scored.json"), (RUN,), _scored),
    Stage("board", BOARD, (RUN,), _board),
    Stage("submit", ("board", "submit", "RUN"), (RUN,), _visible),
    Stage("list", ("list", "runs", "--json", "rows.json"), (RUN,), _visible),
    Stage("report", ("report", "--store", "runs", "--from", "runs"), (RUN,), _visible),
    Stage(
        "speed",
        ("speed", "tiny", "--frames", "5", "--calls", "10", "--json", "speed.json"),
        (RUN,),
        _visible,
    ),
)


def lab_in(place: Path) -> Lab:
    """A laboratory that has imported what the stages need."""
    lab, folder = Lab(place / "lab"), place / "preloading"
    (folder / "leaderboards").mkdir(parents=True)
    lab.preload(folder, RUN, STAGES[0].command, BOARD)
    return lab


@dataclass
class Result:
    """Of one stage. stops: by how they were stopped. wrong: what was not right, in words."""

    stage: str
    stops: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


class Trial:
    """A stage with the folder it begins from, its undisturbed outcome and running time."""

    def __init__(self, stage: Stage, lab: Lab, place: Path) -> None:
        self.lab, self.stage = lab, stage
        self.place = place / stage.name
        self.base = self.place / "base"
        (self.base / "leaderboards").mkdir(parents=True)
        for command in stage.before:
            code, output = lab.run(self.base, command)
            if code:
                raise RuntimeError(f"{command} ended with {code}:\n{output}")
        runs = sorted(p.name for p in self.base.glob("runs/*") if not p.name.startswith("."))
        self.command = tuple(runs[0] if word == "RUN" else word for word in stage.command)
        whole = self.fresh("whole")
        began = time.perf_counter()
        code, output = lab.run(whole, self.command, _counting(self.place / "changes"))
        self.seconds = time.perf_counter() - began
        if code:
            raise RuntimeError(f"{stage.command} ended with {code}:\n{output}")
        self.changes = (self.place / "changes").stat().st_size
        """Operations that change the file system."""
        self.outcome = stage.outcome(whole)
        self.before = _runs(self.base) if stage.name != "generate" else {}

    def fresh(self, name: str) -> Path:
        """The folder as it was before the stage."""
        folder = self.place / name
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.base, folder)
        return folder

    def killed_at(self, seconds: float) -> Path | None:
        """The folder after SIGKILL at that moment; None when the command was done before."""
        folder = self.fresh("killed")
        child = self.lab.fork(folder, self.command)
        time.sleep(seconds)
        os.kill(child, signal.SIGKILL)
        return folder if self.lab.wait(child) == -signal.SIGKILL else None

    def killed_before(self, operation: int) -> Path | None:
        """The same before the n-th operation that changes the file system."""
        folder = self.fresh("killed")
        stop = _at(operation, lambda _: os.kill(os.getpid(), signal.SIGKILL))
        code, _ = self.lab.run(folder, self.command, stop)
        return folder if code == -signal.SIGKILL else None

    def full_from(self, operation: int) -> tuple[Path, int, str]:
        """Folder, exit code and output of a command whose disk is full from an operation on."""
        folder = self.fresh("full")
        code, output = self.lab.run(folder, self.command, _at(operation, _refused))
        return folder, code, output

    def again(self, folder: Path) -> tuple[str, str]:
        """One of OUTCOMES after the same command, and what was wrong."""
        if self.before and (half := self._half(folder)):
            return half
        code, output = self.lab.run(folder, self.command)
        last = output.strip().splitlines()[-1:] or [""]
        if code == 2 and last[0].startswith("tactibench: "):
            return "named", last[0]
        if code:
            return "lost", f"exit code {code}: {output[-600:]}"
        try:
            found = self.stage.outcome(folder)
        except Exception as error:  # noqa: BLE001 - it could not even be read
            return "lost", repr(error)
        return ("right", "") if found == self.outcome else ("silent", "another record")

    def _half(self, folder: Path) -> tuple[str, str] | None:
        """What was in the store before must be there whole, or anew, before anything is mended."""
        from tactibench.errors import UserError

        try:
            found = _runs(folder)
        except UserError as error:
            return "silent", f"half a run is visible: {error}"
        gone = sorted(set(self.before) - set(found))
        return ("lost", f"{gone} is no longer in the store") if gone else None


def _counting(told: Path) -> Callable[[], None]:
    """What a child calls first to leave a byte in a file for every change of the file system."""

    def install() -> None:
        file = os.open(told, os.O_WRONLY | os.O_CREAT)
        _at(1, lambda _: os.write(file, b"."))()

    return install


def _at(operation: int, stop: Callable[[str], Any]) -> Callable[[], None]:
    """What a child calls first: ``stop`` before the n-th change of the file system and after."""

    def install() -> None:
        count = 0
        sync = os.fsync

        def changed(event: str) -> None:
            nonlocal count
            count += 1
            if count >= operation:
                stop(event)

        def heard(event: str, arguments: tuple[Any, ...]) -> None:
            if event in CHANGES or (event == "open" and _writes(arguments)):
                changed(event)

        def synced(file: int) -> None:
            changed("fsync")
            sync(file)

        os.fsync = synced
        sys.addaudithook(heard)

    return install


def _writes(arguments: tuple[Any, ...]) -> bool:
    """Whether an ``open`` makes or changes a file (its third value are the system's flags)."""
    path, _, flags = arguments
    if isinstance(path, int) or str(path) == os.devnull or "__pycache__" in str(path):
        return False
    return bool((flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def _refused(event: str) -> None:
    if event in GROWS:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
