"""Protocols, the questions of the benchmark: versioned, validated and hashed TOML files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
