"""What was heard on a line, as data: pieces of bytes with their time, in files that other programs read, too."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
