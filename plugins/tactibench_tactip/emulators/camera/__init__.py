"""A camera that shows the world: MJPEG over loopback HTTP."""

from tactibench_tactip.emulators.camera.emulator import CameraEmulator

__all__ = ["CameraEmulator"]
