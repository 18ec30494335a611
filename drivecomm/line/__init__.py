"""The turns on one line: the queue by rank and its hosts for threads and tasks, jobs, the attempts of a stop."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
