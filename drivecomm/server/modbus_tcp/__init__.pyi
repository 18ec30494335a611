from .door import ModbusTcpDoor as ModbusTcpDoor, modbus_tcp_door as modbus_tcp_door
from .layout import RegisterRow as RegisterRow
from .printing import (
    registers_as_csv as registers_as_csv,
    registers_as_markdown as registers_as_markdown,
    registers_content as registers_content,
)
from .settings import DoorSettings as DoorSettings, read_door_settings as read_door_settings
