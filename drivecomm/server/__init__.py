"""The server process: it owns the lines of a plant while it runs and gives other programs access to the drives.

Current values are stored in one table, and every command takes the same path, whichever door it comes from. Doors
(HTTP, and those of other packages) are plug-ins that offer both to clients.
"""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Answer": "CommandAnswer",
    "Changes": "ChangeStream",
    "Command": "CommandRequest",
    "DriveState": "DriveSnapshot",
    "History": "PlantHistory",
    "LineState": "LineSnapshot",
    "LoggedIn": "LoginToken",
    "Repeats": "AnswerCache",
    "WayIn": "DoorAccess",
    "ended": "cancel_and_wait",
    "read_way_in": "read_door_access",
    "together": "run_concurrently",
    "way_in_keys": "door_access_keys",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
