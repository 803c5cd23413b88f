"""A UR controller: RTDE, script and dashboard servers, and an arm that moves the world's tool."""

from tactibench_tactip.emulators.ur.emulator import UrEmulator

__all__ = ["UrEmulator"]
