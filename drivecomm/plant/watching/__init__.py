"""Watching a plant: what its drives do now and did lately, apart from any screen."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
