"""Latency of USB adapters: they delay received bytes by up to 16 ms with FTDI's default, 1 ms in low-latency mode.

At 19200 baud the default halves the number of exchanges. Linux has a flag for it in the settings of a serial port, and
ftdi_sio also has a file in sysfs. Other drivers have neither and mostly do not need it.
"""

from __future__ import annotations

import array
import contextlib
import sys
from pathlib import Path
from typing import Any, Literal, TypeAlias

from drivecomm.errors import PortError

Latency: TypeAlias = Literal["on", "off", "unknown"]

_SYSFS = Path("/sys/class/tty")
# Linux, include/uapi/linux/tty_flags.h; `flags` is the fifth word of struct serial_struct.
_ASYNC_LOW_LATENCY = 0x2000
_FLAGS = 4


def enable_low_latency(port: Any, name: str, sysfs: Path = _SYSFS) -> bool:
    """Enable low-latency mode of an open port if possible; return whether it is enabled now."""
    with contextlib.suppress(OSError, ValueError, AttributeError, NotImplementedError):
        port.set_low_latency_mode(True)
    if low_latency(port, name, sysfs) == "on":
        return True
    timer = _timer_file(name, sysfs)
    try:
        # Only administrators may write this file, unless a udev rule permits others.
        if timer.exists():
            timer.write_text("1")
    except OSError:
        return False
    return low_latency(port, name, sysfs) == "on"


def require_low_latency(port: Any, name: str, sysfs: Path = _SYSFS) -> None:
    """Enable low-latency mode. Raises PortError if that fails."""
    if not enable_low_latency(port, name, sysfs):
        raise PortError(
            f"port {name} has no low-latency mode that this program may set; "
            f"open it without low_latency, or have an administrator write 1 to {_timer_file(name, sysfs)}"
        )


def low_latency(port: Any, name: str, sysfs: Path = _SYSFS) -> Latency:
    """Return whether low-latency mode is enabled; "unknown" if the driver does not reveal it."""
    timer = latency_timer_ms(name, sysfs)
    if timer is not None:
        return "on" if timer <= 1 else "off"
    flags = _flags(port)
    if flags is None:
        return "unknown"
    return "on" if flags & _ASYNC_LOW_LATENCY else "off"


def latency_timer_ms(name: str, sysfs: Path = _SYSFS) -> int | None:
    """Return the adapter's latency timer in milliseconds; None if it has none or hides it."""
    try:
        return int(_timer_file(name, sysfs).read_text())
    except (OSError, ValueError):
        return None


def _timer_file(name: str, sysfs: Path) -> Path:
    return sysfs / Path(name).resolve().name / "device" / "latency_timer"


def _flags(port: Any) -> int | None:
    if sys.platform != "linux":
        return None
    import fcntl
    import termios

    settings = array.array("i", [0] * 32)
    try:
        fcntl.ioctl(port.fileno(), termios.TIOCGSERIAL, settings)
    except (OSError, AttributeError, ValueError):
        return None
    return settings[_FLAGS]
