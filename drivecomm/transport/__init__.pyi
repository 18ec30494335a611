from .channel import ChannelGoneError as ChannelGoneError, SettingsRefusedError as SettingsRefusedError
from .holders import Holder as Holder, holder_of_port as holder_of_port, server_of_terminal as server_of_terminal
from .kernel_timer import open_timer as open_timer
from .listening import (
    ListeningPort as ListeningPort,
    MarkedCharacters as MarkedCharacters,
    listening_port as listening_port,
    shared_listening_port as shared_listening_port,
)
from .opening import cannot_open as cannot_open, error_number as error_number
from .port_names import (
    ONE_PROTOCOL as ONE_PROTOCOL,
    same_port as same_port,
    scheme_of as scheme_of,
    stable_name as stable_name,
)
from .port_report import PortReport as PortReport, UsbIdentity as UsbIdentity, local_report as local_report
from .pyserial_channel import PyserialChannel as PyserialChannel
from .readiness import Readable as Readable, send_all as send_all
from .rfc2217_client import Rfc2217Client as Rfc2217Client
from .serial_port import SerialPort as SerialPort
from .socket_channel import SocketChannel as SocketChannel
