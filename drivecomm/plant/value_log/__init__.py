"""Values that were read, kept in files: CSV, which everything reads, and Parquet, which is small and quick."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
