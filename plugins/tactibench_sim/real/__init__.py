"""Simulated against real plate presses: fit the few unknown numbers, report what is left."""
