"""Several contacts from single presses: fields, load sharing, mixed frames. Public to plugins."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
