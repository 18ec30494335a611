from .async_bus import AsyncBus as AsyncBus, open_bus_async as open_bus_async
from .async_drive import AsyncBroadcast as AsyncBroadcast, AsyncDrive as AsyncDrive
from .async_turns import AsyncTurns as AsyncTurns
from .bus import Bus as Bus, open_bus as open_bus
from .drive import Broadcast as Broadcast, Drive as Drive
from .keeping import keep as keep, keep_async as keep_async
from .likely_settings import LineChoices as LineChoices, likely_settings as likely_settings
from .read_only import ReadOnly as ReadOnly
from .roster import Member as Member, Roster as Roster, line_overrides as line_overrides
from .scanning import (
    Asking as Asking,
    Found as Found,
    Search as Search,
    look as look,
    options_of as options_of,
    scan_plan as scan_plan,
)
from .steps import (
    AskIdentity as AskIdentity,
    AskStatus as AskStatus,
    CheckWrite as CheckWrite,
    Read as Read,
    Steps as Steps,
    Write as Write,
    carry_out as carry_out,
    carry_out_async as carry_out_async,
)
from .stored_writes import ALLOWED as ALLOWED, StoredWrites as StoredWrites, is_stored as is_stored
from .turns import Queue as Queue, Rank as Rank, Turn as Turn, Turns as Turns
from .verbs import Verbs as Verbs
from .waiting import Goal as Goal, Waiting as Waiting
from .watchdog import (
    Setting as Setting,
    policies as policies,
    read_watchdog as read_watchdog,
    read_watchdog_async as read_watchdog_async,
    reading_steps as reading_steps,
    set_watchdog as set_watchdog,
    set_watchdog_async as set_watchdog_async,
    setting_steps as setting_steps,
)
