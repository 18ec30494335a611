"""Replays of a captured conversation: virtual drives that answer as recorded, and a master that repeats requests."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
