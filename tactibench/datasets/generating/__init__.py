"""Data sets that a sensor presses: what is to be pressed, and pressing it."""
