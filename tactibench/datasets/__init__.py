"""Frames on disk: generated once, verified when opened, keyed by all that determines them."""
