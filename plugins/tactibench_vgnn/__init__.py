"""Voronoi graph network: pins, their neighbours and the room they have tell the contacts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
