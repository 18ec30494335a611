"""Monitoring of a line on which others talk: the telegrams, their senders, and the replies with their times."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "ParameterNames": "HeardParameterNames",
    "Reading": "TelegramReading",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
