"""Simulated TacTip: a finite-element skin-on-gel dome, pins as levers and a pinhole camera."""
