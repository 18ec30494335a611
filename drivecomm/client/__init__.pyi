from .async_served_bus import AsyncServedBus as AsyncServedBus, AsyncServedDrive as AsyncServedDrive
from .connection import LocalServer as LocalServer
from .kept_motor import KeptMotor as KeptMotor
from .line_streams import examined as examined
from .line_trace import LineEar as LineEar
from .registration import (
    Registration as Registration,
    identity as identity,
    local_socket as local_socket,
    register as register,
    server_of_plant as server_of_plant,
    server_of_port as server_of_port,
    servers as servers,
    written_again as written_again,
)
from .runtime_folders import (
    folder_of_servers as folder_of_servers,
    is_private as is_private,
    users_folder as users_folder,
)
from .served_bus import ServedBus as ServedBus, ServedDrive as ServedDrive
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
