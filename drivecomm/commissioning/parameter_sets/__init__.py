"""Parameter sets: back up a drive, compare, restore; see docs/how-to/parameter-sets.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
