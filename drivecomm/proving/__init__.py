"""A drive held against its model: the questions, what agrees and contradicts, the report, and the marks that follow."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
