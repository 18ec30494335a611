"""Exploration of a drive, address by address; see docs/how-to/everything-a-drive-holds.md."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Answer": "AddressAnswer",
    "Course": "ExplorationPlan",
    "Forecast": "ExplorationForecast",
    "Forgetful": "NoAnswerRecord",
    "Remembers": "AnswerRecord",
    "Step": "ExplorationStep",
    "identity_told": "read_identity",
    "lasting": "lasting_identity",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
