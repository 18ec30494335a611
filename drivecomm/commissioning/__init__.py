"""Commissioning of drives: parameter sets, the line doctor, models grown from a drive, and scan forecasts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
