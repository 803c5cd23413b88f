"""Locks: one holder at a time, none that outlives its process."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.datasets import WriterLock
from tactibench.records import locked

HOLD = """
import sys
from pathlib import Path
from tactibench.datasets.storage import WriterLock
lock = WriterLock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "set" / ".lock"


@pytest.fixture(autouse=True)
def _folder(path: Path) -> None:
    path.parent.mkdir()


def test_a_waiting_lock_lets_one_in_at_a_time(tmp_path: Path) -> None:
    inside, most = 0, 0

    def work() -> None:
        nonlocal inside, most
        for _ in range(10):
            with locked(tmp_path / "deep" / "lock"):
                inside += 1
                most = max(most, inside)
                inside -= 1

    workers = [threading.Thread(target=work) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert (inside, most) == (0, 1)


def test_a_second_writer_is_refused_and_told_who_writes(path: Path) -> None:
    lock = WriterLock(path)
    who = f"set is being written by process {os.getpid()} on {socket.gethostname()}; wait for it"
    with pytest.raises(UserError, match=who):
        WriterLock(path)
    lock.release()
    lock.release()
    assert list(path.parent.iterdir()) == []
    WriterLock(path).release()


def test_the_lock_of_a_killed_process_is_taken_over(path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(UserError, match=f"process {other.pid} on"):
            WriterLock(path)
        other.kill()
    owner = path.with_name(".lock.owner")
    assert json.loads(owner.read_text())["pid"] == other.pid
    lock = WriterLock(path)
    assert json.loads(owner.read_text())["pid"] == os.getpid()
    lock.release()


def test_the_owner_on_another_machine_decides_where_its_lock_is_not_seen(path: Path) -> None:
    owner = path.with_name(".lock.owner")
    owner.write_text(json.dumps({"pid": 4, "host": "robot-lab"}))
    for _ in range(2):
        with pytest.raises(UserError, match=r"4 on robot-lab; when it has ended, delete .*owner"):
            WriterLock(path)
    owner.unlink()
    WriterLock(path).release()


@pytest.mark.parametrize("text", ["", "junk", "[]", "{}", "\x00\x00"])
def test_an_owner_file_that_says_nothing_holds_nobody(path: Path, text: str) -> None:
    path.with_name(".lock.owner").write_text(text)
    WriterLock(path).release()


def test_a_file_system_without_locks_still_lets_one_in(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl", reason="this system has other locks")

    def refuse(_file: int, _how: int) -> None:
        raise OSError(errno.ENOSYS, "no locks here")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.warns(UserWarning, match="flock not supported"):
        lock = WriterLock(path)
    with (
        pytest.warns(UserWarning, match="flock not supported"),
        pytest.raises(UserError, match=f"process {os.getpid()} on"),
    ):
        WriterLock(path)
    lock.release()
    assert list(path.parent.iterdir()) == []
