"""Virtual lines and virtual drives, for tests without hardware and without waiting."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
