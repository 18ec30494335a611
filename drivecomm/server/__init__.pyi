from .door import (
    Answer as Answer,
    Caller as Caller,
    Changes as Changes,
    Command as Command,
    Door as Door,
    Examination as Examination,
    History as History,
    MakeDoor as MakeDoor,
    Outcome as Outcome,
    Role as Role,
    ServedPlant as ServedPlant,
    Users as Users,
)
from .leases import Lease as Lease
from .observations import (
    STATUS as STATUS,
    CurrentValue as CurrentValue,
    DriveState as DriveState,
    Event as Event,
    EventKind as EventKind,
    LineState as LineState,
)
