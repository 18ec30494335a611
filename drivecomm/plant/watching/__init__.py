"""Watching a plant: present and recent values of its drives, independent of any screen."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
