"""What an engineer does with drives: parameter sets, the doctor, models grown from a drive, how long a scan takes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
