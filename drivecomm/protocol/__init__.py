"""Interfaces that protocol packages implement, and types that they share with the rest of drivecomm."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
