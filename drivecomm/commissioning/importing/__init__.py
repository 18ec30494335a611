"""What people already have of a drive: register lists and the configurations of other programs, made into models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
