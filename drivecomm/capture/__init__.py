"""Captures of line traffic as data: pieces of bytes with their times, in files that other programs can read."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
