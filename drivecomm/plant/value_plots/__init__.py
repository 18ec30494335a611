"""Plots of logs of values: PNG, SVG, and pages that need nothing from elsewhere."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
