"""Virtual lines and virtual drives, for tests without hardware and without waiting."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "ServedLine": "VirtualServedLine",
    "parse_place": "parse_socket_address",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
