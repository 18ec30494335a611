"""Captures of line traffic as data: pieces of bytes with their times, in files that other programs can read."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Gaps": "WriteGaps",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
