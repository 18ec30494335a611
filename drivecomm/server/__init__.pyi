from .accepting import Acceptor as Acceptor
from .alarms import Alarm as Alarm, AlarmRule as AlarmRule
from .audit import Audit as Audit
from .callers import ANONYMOUS as ANONYMOUS, LOCAL as LOCAL, Caller as Caller, Role as Role
from .capacity import (
    LOCAL_BOUNDS as LOCAL_BOUNDS,
    Bounds as Bounds,
    TakesConnections as TakesConnections,
    needed_descriptors as needed_descriptors,
    share_connections as share_connections,
    system_limits as system_limits,
)
from .command_words import command_words as command_words
from .credentials import new_token as new_token, password_hash as password_hash, token_hash as token_hash
from .door import (
    AddressesValues as AddressesValues,
    ChangeStream as ChangeStream,
    CommandAnswer as CommandAnswer,
    CommandRequest as CommandRequest,
    Door as Door,
    DoorHealth as DoorHealth,
    Examination as Examination,
    KnownUsers as KnownUsers,
    LoginToken as LoginToken,
    MakeDoor as MakeDoor,
    NamesDrives as NamesDrives,
    Outcome as Outcome,
    PlantHistory as PlantHistory,
    ReportsHealth as ReportsHealth,
    ServedPlant as ServedPlant,
    Stopped as Stopped,
)
from .door_access import (
    DoorAccess as DoorAccess,
    door_access_keys as door_access_keys,
    read_door_access as read_door_access,
)
from .drift_state import (
    DriftKind as DriftKind,
    DriveDrift as DriveDrift,
    NotComparable as NotComparable,
    SetChange as SetChange,
)
from .freshness import check_fresh as check_fresh
from .gc_tuning import keep_searches_short as keep_searches_short
from .history import PastValue as PastValue, PeriodSummary as PeriodSummary, log_row as log_row
from .leases import Lease as Lease, Leases as Leases
from .levels import LEVELS as LEVELS, LEVELS_KEY as LEVELS_KEY, LINE as LINE, PLANT as PLANT, SITES as SITES
from .listening import (
    ListenAddress as ListenAddress,
    is_loopback as is_loopback,
    listen_address as listen_address,
    listen_kind as listen_kind,
)
from .logins import Login as Login, Users as Users
from .logs import LOG_LEVELS as LOG_LEVELS, logging_to as logging_to
from .notify import ServiceManager as ServiceManager
from .observations import (
    CurrentValue as CurrentValue,
    DoorSnapshot as DoorSnapshot,
    DriveSnapshot as DriveSnapshot,
    Event as Event,
    EventKind as EventKind,
    LineSnapshot as LineSnapshot,
    RememberedFault as RememberedFault,
    StandingStop as StandingStop,
)
from .plan_check import LineLoad as LineLoad, line_loads as line_loads
from .rates import Bucket as Bucket, Rate as Rate
from .repeats import AnswerCache as AnswerCache
from .rights import NEEDS as NEEDS, Rights as Rights
from .serving import Serving as Serving
from .settings import (
    HistorySettings as HistorySettings,
    ServerSettings as ServerSettings,
    read_settings as read_settings,
)
from .state_paths import (
    audit_file as audit_file,
    history_file as history_file,
    state_folder as state_folder,
)
from .supervision import kind_of_door as kind_of_door
from .task_groups import cancel_and_wait as cancel_and_wait, run_concurrently as run_concurrently
from .users import (
    ROLES as ROLES,
    User as User,
    add_user as add_user,
    read_users as read_users,
    remove_user as remove_user,
)
