"""Intervals and comparisons whose unit of resampling is the press, never the frame."""
