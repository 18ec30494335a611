"""Commissioning of drives: parameter sets, the line doctor, models grown from a drive, and scan forecasts."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Trial": "TuningTrial",
    "Tuned": "TuningResult",
    "asking": "growth_request",
    "grown": "grown_model",
    "unasked": "unread_parameters",
    "way_to_grow": "growth_plan",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
