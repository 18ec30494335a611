from .async_served_bus import AsyncServedBus as AsyncServedBus, AsyncServedDrive as AsyncServedDrive
from .connection import LocalServer as LocalServer
from .door_for_stops import STOP_LINE as STOP_LINE, StopOrder as StopOrder, stop_door as stop_door
from .line_streams import examination_results as examination_results
from .line_trace import LineEar as LineEar
from .peers import check_peer as check_peer, may_command as may_command, user_of_peer as user_of_peer
from .registration import (
    Registration as Registration,
    check_ports as check_ports,
    holders_of_port as holders_of_port,
    identity as identity,
    local_socket as local_socket,
    register as register,
    rewrite_record as rewrite_record,
    server_of_plant as server_of_plant,
    server_of_port as server_of_port,
    servers as servers,
    servers_of_port as servers_of_port,
)
from .runtime_folders import (
    folder_of_servers as folder_of_servers,
    unusable_reason as unusable_reason,
)
from .served_bus import ServedBus as ServedBus, ServedDrive as ServedDrive
from .served_start import ServedStart as ServedStart
from .stopping import (
    check_alive as check_alive,
    drives_known_to as drives_known_to,
    place_of_name as place_of_name,
    place_on_line as place_on_line,
    request_stop as request_stop,
    stop_on as stop_on,
    stop_on_async as stop_on_async,
)
from .wire import (
    Json as Json,
    drive_options as drive_options,
    error_content as error_content,
    error_of as error_of,
    json_text as json_text,
    parsed as parsed,
    plain as plain,
    reading_of as reading_of,
    result_of as result_of,
    status_of as status_of,
)
