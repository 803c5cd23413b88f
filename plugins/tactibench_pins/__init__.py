"""Regression from the displacements of a sensor's pins to one contact or one plate pose."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
