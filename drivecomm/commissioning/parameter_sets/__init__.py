"""Parameter sets: back up a drive, compare, restore; see docs/how-to/parameter-sets.md."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Entry": "ParameterEntry",
    "Journal": "RestoreJournal",
    "Plan": "RestorePlan",
    "Planned": "PlannedItem",
    "Restored": "RestoreResult",
    "Subject": "SetSubject",
    "way_through": "backup_plan",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
