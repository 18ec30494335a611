"""Drift: what differs in a drive from the set that somebody approved; docs/how-to/parameter-sets.md tells how."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
