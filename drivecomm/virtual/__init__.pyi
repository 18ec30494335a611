from .control_orders import answer_order as answer_order
from .control_socket import (
    _MOST_CLIENTS as _MOST_CLIENTS,
    LONGEST_ORDER as LONGEST_ORDER,
    ControlClient as ControlClient,
    parse_socket_address as parse_socket_address,
)
from .drive_keys import separate_drive_keys as separate_drive_keys, virtual_drive as virtual_drive
from .drive_proxy import DriveProxy as DriveProxy
from .drives import carry_out as carry_out, drive_type as drive_type
from .forecast import Forecast as Forecast, forecast as forecast
from .line import VirtualLine as VirtualLine
from .line_rules import RULES as RULES, LineRules as LineRules, Violation as Violation
from .line_trace import LineTrace as LineTrace, TracedLine as TracedLine
from .listeners import Listener as Listener, parse_listen as parse_listen
from .medium import _MOST_AUDIBLE as _MOST_AUDIBLE, _ROOM as _ROOM, Medium as Medium, Transmission as Transmission
from .plant_record import PlantRecord as PlantRecord
from .port import VirtualPort as VirtualPort
from .rfc2217_listener import PretendedPort as PretendedPort, Rfc2217Listener as Rfc2217Listener
from .serving import (
    LineServer as LineServer,
    PlantServer as PlantServer,
    Server as Server,
    VirtualServedLine as VirtualServedLine,
)
from .station import Restarts as Restarts, Station as Station
from .tcp_listener import TcpListener as TcpListener
from .timing_watch import (
    SERVED_TOLERANCE_S as SERVED_TOLERANCE_S,
    TimingWatch as TimingWatch,
    violations as violations,
)
from .uart import _sampled as _sampled, heard as heard, received as received
from .violation_log import ViolationLog as ViolationLog
from .virtual_plant import VirtualPlant as VirtualPlant
