"""Interfaces that protocol packages implement, and types that they share with the rest of drivecomm."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Command": "MotorCommand",
    "answered": "run_with_answers",
    "kept": "cached",
    "looked_into": "refusals_as_address_errors",
    "maker": "frozen_factory",
    "misfit": "wrong_argument",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
