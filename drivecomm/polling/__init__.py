"""Whose turn it is in a poll plan, and the loops that carry a plan out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
