"""A captured conversation again: virtual drives that answer as recorded, or a master that asks again."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
