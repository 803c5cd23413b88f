"""The lines of a GRBL controller on a pseudo-terminal, as a real port is one."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from tactibench import UserError
from tactibench_tactip.errors import RobotError, RobotLostError
from tactibench_tactip.robots import grbl_link
from tactibench_tactip.robots.grbl_link import GrblLink, NoAnswerError

pytest.importorskip("serial", reason="pyserial is not installed: pip install tactibench[serial]")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def port() -> Iterator[tuple[GrblLink, int]]:
    master, slave = os.openpty()
    link = GrblLink(os.ttyname(slave))
    os.close(slave)
    yield link, master
    link.close()
    with suppress(OSError):
        os.close(master)


@pytest.mark.parametrize(
    ("line", "state", "position"),
    [
        ("<Idle|MPos:1.000,-2.000,3.5|FS:0,0>", "Idle", (1.0, -2.0, 3.5)),
        ("<Hold:0|WPos:1.0,1.0,1.0|Bf:15,128|WCO:1.0,2.0,3.0>", "Hold", (2.0, 3.0, 4.0)),
        ("<Run|FS:0,0|WPos:0,0,0>", "Run", (1.0, 2.0, 3.0)),
        ("<Idle|MPos:1.0,x,3.0>", None, None),
        ("<Idle|MPos:1.0,2.0", None, None),
        ("ok", None, None),
    ],
)
def test_reports(
    port: tuple[GrblLink, int],
    line: str,
    state: str | None,
    position: tuple[float, float, float] | None,
) -> None:
    link, _ = port
    link.parse_status("<Idle|WPos:0,0,0|WCO:1.0,2.0,3.0>")  # the offset is remembered
    status = link.parse_status(line)
    assert (status and status.state, status and status.position) == (state, position)


def test_answers_refusals_and_silence(port: tuple[GrblLink, int]) -> None:
    link, master = port
    os.write(master, b"Grbl 1.1h ['$' for help]\r\n")
    link.wait_banner(2.0)
    assert link.banner.startswith("Grbl 1.1h")
    timer = threading.Timer(0.05, os.write, (master, b"[VER:1.1h]\r\nok\r\n"))
    timer.start()
    assert link.command("$I") == ["[VER:1.1h]"]
    timer.join()
    for answer, message in (
        (b"error:15\r\n", "beyond the stage's travel"),
        (b"error:\xff\r\n", "damaged"),
        (b"", "did not answer"),
    ):
        timer = threading.Timer(0.05, os.write, (master, answer))
        timer.start()
        with pytest.raises(RobotError, match=message):
            link.command("$J=X1", 0.2)
        timer.join()


def answer_as_grbl(master: int, late_s: float, answered: int) -> None:
    """Answer so many lines: the first late, ``$G`` and ``$$`` as GRBL does."""
    told = {b"$G": b"[GC:G1 G21 G90]\r\n", b"$$": b"$13=0\r\n"}
    text = b""
    for number in range(answered):
        while b"\n" not in text:
            text += os.read(master, 100)
        line, _, text = text.partition(b"\n")
        time.sleep(0.0 if number else late_s)
        os.write(master, told.get(line, b"") + b"ok\r\n")


@pytest.mark.parametrize("line", ["", "$I"])
def test_a_late_answer_is_not_taken_for_that_of_the_next_line(
    port: tuple[GrblLink, int], line: str
) -> None:
    link, master = port
    stage = threading.Thread(target=answer_as_grbl, args=(master, 0.3, 3))
    stage.start()
    with pytest.raises(NoAnswerError):
        link.command(line, 0.1)
    assert link.command("$$") == ["$13=0"]
    stage.join()


def test_answers_that_stay_away_are_a_lost_stage(
    port: tuple[GrblLink, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    link, _ = port
    monkeypatch.setattr(grbl_link, "ANSWER_S", 0.1)
    with pytest.raises(NoAnswerError):
        link.command("$$", 0.1)
    with pytest.raises(RobotLostError, match="too late or not at all"):
        link.command("$$", 0.1)


def test_a_port_is_held_alone_and_its_loss_is_told(port: tuple[GrblLink, int]) -> None:
    link, master = port
    with pytest.raises(UserError, match="no other program holds it"):
        GrblLink(link._port.port)
    os.close(master)
    with pytest.raises(RobotLostError, match="the serial port went away"):
        link.status()
