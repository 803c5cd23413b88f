"""The frames of a run: their sources and their cache."""
