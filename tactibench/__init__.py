"""Benchmark for soft optical tactile sensors read by learned models.

Everything a plugin needs is exported here. The names are listed in ``__init__.pyi`` and imported
when they are used: ``import tactibench`` loads neither numpy nor torch.
"""

import os
from pathlib import Path

import lazy_loader

__version__ = "0.1.0"

if "TACTIBENCH_CACHE" in os.environ and not os.access(Path(__file__).parent, os.W_OK):
    # numba keeps compiled loops beside the modules, which cannot be written here.
    _folder = Path(os.environ["TACTIBENCH_CACHE"]).expanduser() / "numba"
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_folder))

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
