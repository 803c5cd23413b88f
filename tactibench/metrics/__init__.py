"""Predictions against truth: one family of metrics a file, `score.score` the entry point."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
