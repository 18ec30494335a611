"""The way to a server that runs: where it is found, what goes over its local socket, and drives reached through it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
