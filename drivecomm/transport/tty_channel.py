"""Terminals of POSIX systems: pyserial opens and configures them, bytes pass by the descriptor.

poll wakes as soon as bytes are there and costs a fifth of pyserial's read. Nothing waits until characters are on the
wire: the kernel looks at that only every few milliseconds.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import select
import sys
import termios
import time
from typing import TYPE_CHECKING, Any

from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError
from drivecomm.transport.opening import error_number
from drivecomm.transport.pyserial_channel import release, set_at_once

if TYPE_CHECKING:
    from serial import Serial

    from drivecomm.line import LineSettings

_CHUNK = 4096
_LONGEST_POLL_S = 3600.0
_GONE = frozenset({errno.EIO, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.EPIPE})
# Majors 136 to 143 are the slaves of pseudo-terminals (Linux, Documentation/admin-guide/devices.txt).
_LINUX_PTY_MAJORS = range(136, 144)
_PTY_NAMES = re.compile(r"/dev/(pts/\d+|ttys\d+|tty[p-zP-T][0-9a-f])")


class TtyChannel:
    """An open terminal: a real port, or a pseudo-terminal, which has no characters and so no parity."""

    def __init__(self, port: Serial) -> None:
        self._port: Any = port
        self._descriptor = port.fileno()
        self._pseudo = _is_pseudo(self._descriptor)
        self._readable = select.poll()
        self._readable.register(self._descriptor, select.POLLIN)
        self._writable = select.poll()
        self._writable.register(self._descriptor, select.POLLOUT)
        if not self._pseudo:
            # USB adapters hold received bytes back for up to 16 ms otherwise; not every driver knows the request.
            with contextlib.suppress(OSError, ValueError, AttributeError, NotImplementedError):
                self._port.set_low_latency_mode(True)

    @property
    def paced(self) -> bool:
        """A pseudo-terminal has no speed."""
        return not self._pseudo

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings without closing. Raises SettingsRefusedError."""
        try:
            if not self._pseudo:
                set_at_once(self._port, settings)
                return ""
            # Linux answers a request for anything but 8N on a pseudo-terminal with EINVAL.
            set_at_once(self._port, settings, bytesize=8, parity="N")
        except (OSError, ValueError, termios.error) as error:
            if error_number(error) in _GONE:
                raise ChannelGoneError("it was unplugged, or its other end was closed") from error
            raise SettingsRefusedError(str(error)) from error
        if settings.bytesize == 8 and settings.parity == "N":
            return ""
        form = f"{settings.bytesize}{settings.parity}{settings.stopbits:g}"
        return f"pseudo-terminal: {form} is not carried, characters pass as they are"

    def send(self, data: bytes, limit_s: float) -> None:
        """Hand over all bytes within this time."""
        until = time.monotonic() + limit_s
        try:
            while True:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self._descriptor, data) :]
                if not data:
                    return
                left = until - time.monotonic()
                if left <= 0:
                    break
                self._writable.poll(math.ceil(left * 1000))
        except OSError as error:
            raise _gone(error) from error
        # Otherwise closing would wait for these bytes once more, up to half a minute.
        with contextlib.suppress(termios.error):
            termios.tcflush(self._descriptor, termios.TCOFLUSH)
        raise ChannelGoneError(f"it took no bytes for {limit_s:.0f} s")

    def receive(self, wait_s: float, wanted: int) -> bytes:  # noqa: ARG002 - poll wakes for any byte
        """Return what is there, or comes first within this time."""
        try:
            if not self._readable.poll(math.ceil(min(wait_s, _LONGEST_POLL_S) * 1000)):
                return b""
            data = os.read(self._descriptor, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _gone(error) from error
        if not data:
            raise ChannelGoneError("it was unplugged, or its other end was closed")
        return data

    def close(self) -> None:
        """Give the port back; what was sent still goes out."""
        release(self._port)


def _is_pseudo(descriptor: int) -> bool:
    if sys.platform == "linux":
        return os.major(os.fstat(descriptor).st_rdev) in _LINUX_PTY_MAJORS
    try:
        return _PTY_NAMES.fullmatch(os.ttyname(descriptor)) is not None
    except OSError:
        return False


def _gone(error: OSError) -> ChannelGoneError:
    if error.errno in _GONE:
        return ChannelGoneError("it was unplugged, or its other end was closed")
    return ChannelGoneError(error.strerror or str(error))
