"""Training shared by the learned models: recipes, a resumable deterministic loop, safe weights.

Public to plugins. torch is imported inside the modules, and only when a name here is used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
