from .door import (
    Answer as Answer,
    Caller as Caller,
    Changes as Changes,
    Command as Command,
    Door as Door,
    MakeDoor as MakeDoor,
    Outcome as Outcome,
    Role as Role,
    ServedPlant as ServedPlant,
)
from .leases import Lease as Lease
from .logs import LOG_LEVELS as LOG_LEVELS, logging_to as logging_to
from .notify import ServiceManager as ServiceManager
from .observations import (
    STATUS as STATUS,
    CurrentValue as CurrentValue,
    DriveState as DriveState,
    Event as Event,
    EventKind as EventKind,
    LineState as LineState,
)
