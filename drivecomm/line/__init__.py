"""One line: its queue by rank, its jobs and poll plans, and the hosts that wait for turns and for ports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
