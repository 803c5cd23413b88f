"""A rehearsal as a lab sees it: devices in one process, ``tactibench hw`` in another.

Time runs as fast as it does, the camera makes 30 frames/s, and a stage is a serial port.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tactibench_tactip.commands.emulate import as_toml
from tactibench_tactip.emulators import Emulation, rehearse
from tactibench_tactip.settings import Settings, example_configuration

ROOT = Path(__file__).parents[2]
LIMIT_S = 120.0
"""A process that has not ended by then hangs."""


@dataclass(frozen=True)
class Lab:
    """Running devices and the configuration that finds them."""

    emulation: Emulation
    config: Path
    folder: Path

    def hw(
        self,
        *arguments: str,
        meanwhile: Callable[[subprocess.Popen[str]], object] = lambda _: None,
        largest_file: int | None = None,
    ) -> tuple[int, str]:
        """Run ``tactibench hw`` and return its exit code and all that it printed.

        Args:
            arguments: The command and its arguments; the configuration is added.
            meanwhile: What happens while it runs.
            largest_file: Bytes at which the disk is full for it.
        """

        def prepare() -> None:
            import resource

            # A background job, as the tests may be, ignores Ctrl-C and hands that down.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            if largest_file is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

        paths = [str(ROOT), str(ROOT / "plugins")]
        with subprocess.Popen(
            [sys.executable, "-m", "tactibench", "hw", *arguments, "--config", str(self.config)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            process_group=0,
            preexec_fn=prepare,
        ) as process:
            try:
                meanwhile(process)
                out, _ = process.communicate(timeout=LIMIT_S)
            finally:
                process.kill()
        return process.returncode, out


@contextmanager
def lab(folder: Path, driver: str) -> Iterator[Lab]:
    """Run the devices of a default configuration: driver "ur" or "grbl"."""
    settings = Settings.model_validate(tomllib.loads(example_configuration(driver)))
    settings = settings.with_changes(contact={"method": "fixed"})
    with rehearse(settings, time_scale=1.0, fps=30.0) as rehearsal:
        found = rehearsal.settings
        with _as_serial_port(found) as address:
            path = folder / "lab.toml"
            robot = {"address": address, "watchdog_hz": settings.robot.watchdog_hz}
            path.write_text(as_toml(found.with_changes(robot=robot)))
            yield Lab(rehearsal.emulation, path, folder)


@contextmanager
def _as_serial_port(settings: Settings) -> Iterator[str]:
    """Yield the robot's address; a stage's socket is reached through a pseudo-terminal."""
    if settings.robot.driver != "grbl":
        yield settings.robot.address
        return
    host, port = settings.robot.address.removeprefix("socket://").split(":")
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    end = threading.Event()
    bridge = threading.Thread(target=_bridge, args=(ours, host, int(port), end), daemon=True)
    bridge.start()
    try:
        yield os.ttyname(theirs)
    finally:
        end.set()
        bridge.join(5.0)
        for number in (ours, theirs):
            os.close(number)


def _bridge(terminal: int, host: str, port: int, end: threading.Event) -> None:
    """Carry bytes both ways; a device that is unplugged stays silent until it is plugged in."""
    while not end.is_set():
        try:
            device = socket.create_connection((host, port), timeout=1.0)
        except OSError:
            time.sleep(0.1)
            continue
        with device, selectors.DefaultSelector() as selector:
            selector.register(terminal, selectors.EVENT_READ)
            selector.register(device, selectors.EVENT_READ)
            while not end.is_set():
                ready = {key.fileobj for key, _ in selector.select(0.2)}
                try:
                    if terminal in ready:
                        device.sendall(os.read(terminal, 4096))
                    if device in ready:
                        data = device.recv(4096)
                        if not data:
                            break
                        os.write(terminal, data)
                except OSError:
                    break


def write_plan(folder: Path, presses: int) -> Path:
    """Write and return a plan of single presses at different places."""
    path = folder / "plan.jsonl"
    rows = [
        {
            "id": number,
            "indenter": "single",
            "indenter_radius_mm": 3.0,
            "x_mm": 0.5 * number - 1.0,
            "y_mm": 0.0,
            "depth_mm": 2.0,
        }
        for number in range(presses)
    ]
    path.write_text("\n".join(map(json.dumps, rows)))
    return path


def wait_for_rows(journal: Path, count: int) -> None:
    """Wait until so many samples are written."""
    end = time.monotonic() + LIMIT_S / 2
    while time.monotonic() < end:
        if journal.exists() and len(journal.read_bytes().splitlines()) >= count:
            return
        time.sleep(0.02)
