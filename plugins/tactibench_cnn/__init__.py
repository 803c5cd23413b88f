"""Regression CNN that reads one contact or one plate pose from a frame."""
