"""A model that answers frames while somebody looks on: a page of this machine shows both."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
