"""A GRBL 1.1h controller on a pseudo-terminal or a socket, and a stage that moves the tool."""

from tactibench_tactip.emulators.grbl.emulator import GrblEmulator

__all__ = ["GrblEmulator"]
