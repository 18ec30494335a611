"""Control profiles as data, the commands of a master by a profile, and virtual drives that follow one.

No I/O, no clock.
"""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Carrier": "WordTransport",
    "Condition": "BitCondition",
    "ONLY": "SOLE_PLACE",
    "OrderCarrier": "RegisterCommandTransport",
    "OrderMachine": "RegisterCommandMachine",
    "OrderMemory": "RegisterCommandMemory",
    "Place": "RegisterPlace",
    "Refusal": "StartRefusal",
    "Step": "ControlStep",
    "TRIPPED": "FAULT_PLACE",
    "Target": "RegisterParameter",
    "Transition": "StateTransition",
    "WayOfWriting": "WritePlan",
    "have_do": "drive_motor",
    "stop_for_sure": "stop_safely",
    "taken_over": "signed_reference",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
