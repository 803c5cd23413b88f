"""One writer at a time."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tactibench import UserError
from tactibench.datasets.v1 import Writer
from tactibench.datasets.v1 import lock as locks
from tactibench.datasets.v1.lock import Lock, start_of

HOLD = """
import sys
from pathlib import Path
from tactibench.datasets.v1.lock import Lock
Lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_a_second_writer_is_refused_and_told_who_writes(open_set: Path, header: Any) -> None:
    who = f"being written by process {os.getpid()} on {socket.gethostname()}; wait for it"
    with Writer(open_set, header()), pytest.raises(UserError, match=who):
        Writer(open_set, header())
    with pytest.raises(UserError, match="closed"):
        Writer(open_set, header())


def test_the_lock_of_a_killed_process_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(UserError, match=f"process {other.pid} on"):
            Lock(path)
        other.kill()
    assert json.loads(path.read_text())["pid"] == other.pid
    lock = Lock(path)
    assert json.loads(path.read_text())["pid"] == os.getpid()
    lock.release()
    lock.release()
    assert not path.exists()


def owner(path: Path, **keys: Any) -> None:
    base = {"pid": os.getpid(), "host": socket.gethostname(), "start": start_of(os.getpid())}
    path.write_text(json.dumps({**base, **keys}))


def test_another_machine_is_asked_to_be_looked_at(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    owner(path, host="robot-lab", pid=4)
    with pytest.raises(UserError, match=r"4 on robot-lab; when it has ended, delete .*lock"):
        Lock(path)
    path.unlink()
    Lock(path).release()


@pytest.mark.parametrize("text", ["", "junk", "[]", "{}", "\x00\x00"])
def test_a_lock_file_that_says_nothing_holds_nobody(tmp_path: Path, text: str) -> None:
    (tmp_path / ".lock").write_text(text)
    Lock(tmp_path / ".lock").release()


class TestWithoutFileLocks:
    """Some network file systems have none: the text of the file decides."""

    @pytest.fixture(autouse=True)
    def _none(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(locks, "_flock", lambda _: None)

    def test_a_living_owner_holds_it(self, tmp_path: Path) -> None:
        lock = Lock(tmp_path / ".lock")
        with pytest.raises(UserError, match=f"process {os.getpid()} on"):
            Lock(tmp_path / ".lock")
        lock.release()
        Lock(tmp_path / ".lock").release()

    @pytest.mark.skipif(not start_of(os.getpid()), reason="this system does not tell of processes")
    def test_a_dead_owner_and_a_number_that_was_given_again_do_not(self, tmp_path: Path) -> None:
        path = tmp_path / ".lock"
        owner(path, pid=os.getppid(), start=start_of(os.getppid()))
        with pytest.raises(UserError, match=f"process {os.getppid()} on"):
            Lock(path)
        owner(path, pid=os.getppid(), start="1")
        Lock(path).release()
        owner(path, pid=2**22 + 1)  # above what Linux gives
        Lock(path).release()
