"""Fitted sensors: camera, pins and a plate's drag fitted to recorded real presses."""
