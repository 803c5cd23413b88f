"""Sensor `recorded`: the presses of a folder of recorded frames."""
