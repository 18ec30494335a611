"""Control profiles as data, the commands of a master by a profile, and virtual drives that follow one.

No I/O, no clock.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
