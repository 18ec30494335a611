"""Drive models as data: their files and the rules for these, common quantities, units."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
