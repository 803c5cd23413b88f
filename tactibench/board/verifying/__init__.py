"""Scoring a stranger's submission again, with nothing of theirs but two files of data."""
