"""Superposition fit: contacts whose single-press fields add up to the motion of the pins."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
