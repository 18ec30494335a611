"""Access to a running server: discovery, messages over its local socket, and drives reached through it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
