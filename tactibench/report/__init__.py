"""Results for people: tables, pictures and pages made from typed rows."""

import os
import sys
from typing import Any

import lazy_loader

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Return a public name; its module is imported, whatever backend matplotlib is to have."""
    try:
        return _attribute(name)
    except ValueError:  # a notebook sets it for all that it starts, installed there or not
        backend = os.environ.pop("MPLBACKEND", None)
        if backend is None:
            raise
        for module in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
            del sys.modules[module]  # half of it is there
        try:
            return _attribute(name)
        finally:
            os.environ["MPLBACKEND"] = backend
