"""Exploration of a drive, address by address; see docs/how-to/everything-a-drive-holds.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
