"""The check whether drives on one line can mistake each other's telegrams for their own."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Proof": "MistakeProof",
    "Reader": "TelegramFinder",
    "partners_of": "line_drives_of",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
