"""Predictions against truth: one family of metrics a file, `score.score` the entry point."""
