"""Regression CNN that reads one contact or one plate pose from a frame."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
