"""Sensor `tactip`: a real TacTip pressed by a UR arm or a serial stage, and emulators of both."""
