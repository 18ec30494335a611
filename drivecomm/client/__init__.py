"""Access to a running server: discovery, messages over its local socket, and drives reached through it."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "examined": "examination_results",
    "written_again": "rewrite_record",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
