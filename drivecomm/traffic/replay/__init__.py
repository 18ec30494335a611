"""Replays of a captured conversation: virtual drives that answer as recorded, and a master that repeats requests."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "described": "request_as_text",
    "meanings": "decoded_requests",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
