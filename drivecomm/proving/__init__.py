"""Proofs: a real drive compared with its model by reads; the report, and the marks in the model that follow from it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
