"""Asking a drive what it holds, address by address; docs/how-to/everything-a-drive-holds.md tells how."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
