"""Markers (pins) of a tactile frame: found in the picture, followed from the undeformed layout."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
