"""Sensor `recorded`: answers the presses that somebody recorded in a folder."""
