"""A model that answers frames live, on a web page of this machine that shows frames and answers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
