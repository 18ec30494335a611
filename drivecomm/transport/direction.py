"""RS-485 direction control by the kernel: the driver switches the transmitter with character accuracy."""

from __future__ import annotations

import array
import sys
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from serial.rs485 import RS485Settings

from drivecomm.errors import PortError

if TYPE_CHECKING:
    from serial import SerialBase

Direction: TypeAlias = Literal["on", "off", "unsupported"]

# Linux, include/uapi/asm-generic/ioctls.h and include/uapi/linux/serial.h
_TIOCGRS485 = 0x542E
_ENABLED = 1


def switch_on(port: SerialBase, name: str) -> None:
    """Enable direction control in the driver of an open port. Raises PortError if it is not supported."""
    control: Any = port
    try:
        # pyserial repeats this at every configuration of the port.
        control.rs485_mode = RS485Settings()
    except (ValueError, OSError, NotImplementedError) as error:
        raise _refused(name, str(error)) from error
    # Some drivers accept the request without doing anything.
    if direction(port) != "on":
        raise _refused(name, "it ignores the request")


def direction(port: Any) -> Direction:
    """Return whether the driver of an open port controls the direction; "off" does not imply that it could."""
    if sys.platform != "linux":
        return "unsupported"
    import fcntl

    asked = array.array("i", [0] * 8)
    try:
        fcntl.ioctl(port.fileno(), _TIOCGRS485, asked)
    except (OSError, AttributeError, ValueError):
        return "unsupported"
    return "on" if asked[0] & _ENABLED else "off"


def _refused(name: str, why: str) -> PortError:
    return PortError(
        f"the driver of port {name} has no RS-485 direction control ({why}); "
        "open it without rs485, with an adapter that switches by itself"
    )
