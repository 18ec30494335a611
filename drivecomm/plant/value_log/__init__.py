"""Logs of values in files: CSV, which every program reads, and Parquet, which is small and fast."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
