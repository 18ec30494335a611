"""The master's side of a line: buses and drives, blocking and asynchronous, with scans and watchdogs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
