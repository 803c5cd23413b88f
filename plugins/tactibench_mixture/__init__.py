"""A model that says where contacts are and how sure it is: a mixture of Gaussians per frame."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
