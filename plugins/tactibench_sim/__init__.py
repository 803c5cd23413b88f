"""Simulated TacTip: a finite-element skin-on-gel dome, pins as levers, a camera in a window."""
