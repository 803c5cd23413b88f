"""``tactibench hw list``."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import click

from tactibench_tactip.commands.output import print_rows

DRIVERS = (
    ("ur (ur_rtde)", "rtde_control", "pip install 'tactibench[ur]'; no wheel for Python 3.13"),
    ("grbl (pyserial)", "serial", "pip install 'tactibench[serial]'"),
)
"""Name, module that shows whether it is installed, remedy."""


@click.command("list")
def command() -> None:
    """List cameras and serial ports, and which drivers are installed."""
    rows = [("camera", str(path), path.resolve().name) for path in _cameras()]
    rows = rows or [("camera", "none found", "")]
    rows += _ports() or [("serial port", "none found", "")]
    for name, module, remedy in DRIVERS:
        rows.append(("driver", name, "installed" if find_spec(module) else f"missing: {remedy}"))
    print_rows(("what", "name for the configuration", ""), rows)


def _cameras() -> list[Path]:
    """Return the cameras by stable names, if there are any.

    Names /dev/videoN change with the devices that are plugged in.
    """
    named = sorted(Path("/dev/v4l/by-id").glob("*index0"))
    return named or sorted(Path("/dev").glob("video[0-9]*"))


def _ports() -> list[tuple[str, str, str]]:
    if not find_spec("serial"):
        return []
    from serial.tools import list_ports

    stable = {path.resolve(): path for path in Path("/dev/serial/by-id").glob("*")}
    return [
        ("serial port", str(stable.get(Path(port.device), port.device)), port.description or "")
        for port in list_ports.comports()
        if port.hwid != "n/a"
    ]
