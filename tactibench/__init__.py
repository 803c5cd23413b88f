"""Benchmark for soft optical tactile sensors read by learned models.

Everything a plugin needs is exported here. The names are listed in ``__init__.pyi`` and imported
when they are used: ``import tactibench`` loads neither numpy nor torch.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
