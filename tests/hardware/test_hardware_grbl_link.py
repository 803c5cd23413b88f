"""The lines of a GRBL controller on a pseudo-terminal, as a real port is one."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from tactibench import UserError
from tactibench_tactip.errors import RobotError, RobotLostError
from tactibench_tactip.robots.grbl_link import GrblLink

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
    timer = threading.Timer(0.05, os.write, (master, b"[VER:1.1h]\r\nok\r\n"))
    timer.start()
    assert link.command("$I") == ["[VER:1.1h]"]
    timer.join()


def test_a_port_is_held_alone_and_its_loss_is_told(port: tuple[GrblLink, int]) -> None:
    link, master = port
    with pytest.raises(UserError, match="no other program holds it"):
        GrblLink(link._port.port)
    os.close(master)
    with pytest.raises(RobotLostError, match="the serial port went away"):
        link.status()
