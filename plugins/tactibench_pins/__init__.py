"""Regression from the displacements of a sensor's pins to one contact or one plate pose."""
