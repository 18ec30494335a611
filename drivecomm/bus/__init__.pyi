from .async_bus import AsyncBus as AsyncBus, open_bus_async as open_bus_async
from .bus import Bus as Bus, open_bus as open_bus
from .call_styles import BlockingCalls as BlockingCalls, RemoteCalls as RemoteCalls
from .discoverable import Discoverable as Discoverable
from .drives import (
    AsyncBroadcast as AsyncBroadcast,
    AsyncDrive as AsyncDrive,
    Broadcast as Broadcast,
    Drive as Drive,
)
from .exchanges import Exchanges as Exchanges
from .feeding import Feeding as Feeding
from .keep_policy import (
    LONGEST_LEASE_S as LONGEST_LEASE_S,
    REFRESHES_IN_TIME as REFRESHES_IN_TIME,
    USUAL_WATCHDOG_S as USUAL_WATCHDOG_S,
    lease_s as lease_s,
)
from .keep_reports import KeepReports as KeepReports
from .keeping import WatchdogKeeper as WatchdogKeeper, keep as keep, keep_async as keep_async
from .likely_settings import LineChoices as LineChoices, likely_settings as likely_settings
from .line_drives import DriveParts as DriveParts, LineDrives as LineDrives
from .line_interface import AwaitedLine as AwaitedLine, BlockingLine as BlockingLine, LineInterface as LineInterface
from .line_options import (
    LineOptions as LineOptions,
    check_line_options as check_line_options,
    lists_line_options as lists_line_options,
)
from .opening import port_opener as port_opener
from .procedures import (
    Goal as Goal,
    GoalWait as GoalWait,
    Procedure as Procedure,
    ask_identity as ask_identity,
    ask_status as ask_status,
    carry_out as carry_out,
    carry_out_async as carry_out_async,
    check_write as check_write,
    in_ram_only as in_ram_only,
    reaching as reaching,
    read_parameter as read_parameter,
    reading_speed as reading_speed,
    sleep_until as sleep_until,
    starting as starting,
    starting_by as starting_by,
    stop_motor as stop_motor,
    write_parameter as write_parameter,
)
from .read_only import ReadOnly as ReadOnly
from .scanning import (
    Found as Found,
    ScanProbe as ScanProbe,
    ScanRequest as ScanRequest,
    Search as Search,
    options_of as options_of,
    probe as probe,
    scan_plan as scan_plan,
)
from .stopping_all import (
    DrivesToStop as DrivesToStop,
    OnResult as OnResult,
    StopResult as StopResult,
    broadcasting as broadcasting,
    broadcasting_to_others as broadcasting_to_others,
    broadcasts_of as broadcasts_of,
    checking_right_drive as checking_right_drive,
    stop_of_all as stop_of_all,
    stopping_all as stopping_all,
    stopping_everybody as stopping_everybody,
    stopping_line as stopping_line,
)
from .stored_writes import ALLOWED as ALLOWED, StoredWrites as StoredWrites, is_stored as is_stored
from .valid_options import make_despite_errors as make_despite_errors
from .verbs import BroadcastVerbs as BroadcastVerbs, DriveVerbs as DriveVerbs
from .watchdog import (
    Setting as Setting,
    policies as policies,
    read_watchdog as read_watchdog,
    read_watchdog_async as read_watchdog_async,
    reading_watchdog as reading_watchdog,
    restoring_watchdog as restoring_watchdog,
    set_watchdog as set_watchdog,
    set_watchdog_async as set_watchdog_async,
    setting_watchdog as setting_watchdog,
)
