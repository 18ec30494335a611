"""The check whether drives on one line can mistake each other's telegrams for their own."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
