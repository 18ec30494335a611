"""The link of one line, without I/O: correlation, repetition, draining, echo, health, statistics, trace."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
