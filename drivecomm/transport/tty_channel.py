"""Terminals of POSIX systems: pyserial opens and configures them, bytes pass by the descriptor.

poll wakes as soon as enough bytes are there and costs a fifth of pyserial's read. Nothing waits until characters are on
the wire: the kernel looks at that only every few milliseconds.
"""

from __future__ import annotations

import array
import contextlib
import errno
import fcntl
import os
import sys
import termios
import time
from typing import TYPE_CHECKING, Any

from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError
from drivecomm.transport.opening import error_number
from drivecomm.transport.port_names import is_pseudo
from drivecomm.transport.pyserial_channel import release, set_at_once
from drivecomm.transport.readiness import Readable, send_all

if TYPE_CHECKING:
    from serial import Serial

    from drivecomm.protocol import LineSettings

_CHUNK = 4096
_GONE = frozenset({errno.EIO, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.EPIPE})
_GONE_TEXT = "it was unplugged, or its other end was closed"
# VMIN is an unsigned character (termios(3)).
_LONGEST_HOLD = 255
# A change is a system call of some 3 us, but a message on the USB with ftdi_sio, which sets the flow control at each.
_DEAR_S = 100e-6
# A character with a wrong parity or stop bit is dropped, so that its telegram is too short to be believed. Otherwise it
# is delivered as it came, or as NUL, and an exclusive-or check passes one such telegram in 256.
_DROP_SPOILT = termios.INPCK | termios.IGNPAR

_monotonic = time.monotonic


class TtyChannel:
    """An open terminal: a real port, or a pseudo-terminal, which has no characters and so no parity.

    Where that is cheap, the kernel wakes nobody before a whole telegram is there (VMIN); otherwise for any byte.
    """

    def __init__(self, port: Serial) -> None:
        self._port: Any = port
        self.descriptor: int = port.fileno()
        keep_others_out(self.descriptor)
        self._pseudo = is_pseudo(self.descriptor)
        self._readable = Readable(self.descriptor)
        # Longer than it must be: for a short one Python lets other threads run meanwhile, and gets its turn back late.
        self._waiting = array.array("i", [0] * 512)
        # The kernel's own record of the attributes, as long for the same reason, and where in it VMIN stands. Setting
        # this is one system call, and `tcsetattr` four.
        self._record = bytearray(2048)
        self._vmin_at = -1
        # pyserial then sets VMIN to 1 whenever it configures the port, instead of 0, with which a read of nothing
        # could not be told from the end.
        self._port.inter_byte_timeout = 0.0
        self._held = 1
        self._attributes: list[Any] = termios.tcgetattr(self.descriptor)
        self._set_input_flags(self._attributes[0] | _DROP_SPOILT)
        self._holds_back = sys.platform == "linux" and self._changes_quickly()

    @property
    def paced(self) -> bool:
        """A pseudo-terminal has no speed."""
        return not self._pseudo

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings without closing. Raises SettingsRefusedError."""
        # A change of settings that a port refuses is only reported when nothing else changes with it.
        self._set_input_flags(self._attributes[0] & ~_DROP_SPOILT)
        try:
            if self._pseudo:
                # Linux answers a request for anything but 8N on a pseudo-terminal with EINVAL.
                set_at_once(self._port, settings, bytesize=8, parity="N")
            else:
                set_at_once(self._port, settings)
        except (OSError, ValueError, termios.error) as error:
            if error_number(error) in _GONE:
                raise ChannelGoneError(_GONE_TEXT) from error
            raise SettingsRefusedError(str(error)) from error
        finally:
            # Refused or not: VMIN may have been set before.
            self._reread_attributes()
            self._set_input_flags(self._attributes[0] | _DROP_SPOILT)
        if not self._pseudo or (settings.bytesize == 8 and settings.parity == "N"):
            return ""
        form = f"{settings.bytesize}{settings.parity}{settings.stopbits:g}"
        return f"pseudo-terminal: {form} is not carried, characters pass as they are"

    def send(self, data: bytes, limit_s: float) -> None:
        """Hand over all bytes within this time."""
        try:
            if send_all(self._write, self.descriptor, data, limit_s):
                return
        except OSError as error:
            raise _gone(error) from error
        # Otherwise closing would wait for these bytes once more, up to half a minute.
        with contextlib.suppress(termios.error):
            termios.tcflush(self.descriptor, termios.TCOFLUSH)
        raise ChannelGoneError(f"it took no bytes for {limit_s:.0f} s")

    def receive(self, until: float, wanted: int) -> bytes:
        """Return what is there as soon as it is so much; at `until` what there is."""
        if until <= _monotonic():
            # Mostly there is nothing, and asking for the number costs a third of a read in vain.
            return self.take() if self._number_waiting() else b""
        data = b""
        while True:
            missing = wanted - len(data)
            if missing != self._held:
                self.hold_back(missing)
            if not self._readable.wait(until):
                return data + self.take()
            data = data + self.take() if data else self.take()
            if len(data) >= wanted:
                return data

    def take(self) -> bytes:
        """Return what is there."""
        try:
            data = os.read(self.descriptor, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _gone(error) from error
        if not data and self._readable.now():
            raise ChannelGoneError(_GONE_TEXT)
        return data

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for so many bytes, where that costs next to nothing."""
        at_least = max(1, min(at_least, _LONGEST_HOLD))
        if at_least == self._held or not self._holds_back:
            return
        try:
            self._hold(at_least)
        except OSError as error:
            raise _gone(error) from error

    def close(self) -> None:
        """Give the port back; what was sent still goes out."""
        let_others_in(self.descriptor)
        release(self._port)

    def _write(self, data: bytes) -> int:
        return os.write(self.descriptor, data)

    def _number_waiting(self) -> int:
        try:
            fcntl.ioctl(self.descriptor, termios.FIONREAD, self._waiting)
        except OSError as error:
            raise _gone(error) from error
        return self._waiting[0]

    def _hold(self, number: int) -> None:
        self._record[self._vmin_at] = number
        fcntl.ioctl(self.descriptor, termios.TCSETS, self._record)
        self._attributes[6][termios.VMIN] = self._held = number

    def _set_input_flags(self, flags: int) -> None:
        if self._pseudo or flags == self._attributes[0]:
            return
        self._attributes[0] = flags
        with contextlib.suppress(termios.error):
            termios.tcsetattr(self.descriptor, termios.TCSANOW, self._attributes)
        self._reread_record()

    def _reread_attributes(self) -> None:
        try:
            self._attributes = termios.tcgetattr(self.descriptor)
        except termios.error as error:
            raise _gone(OSError(*error.args)) from error
        self._held = self._attributes[6][termios.VMIN]
        self._reread_record()

    def _reread_record(self) -> None:
        if self._vmin_at >= 0:
            with contextlib.suppress(OSError):
                fcntl.ioctl(self.descriptor, termios.TCGETS, self._record)

    def _changes_quickly(self) -> bool:
        quickest, records = _DEAR_S, []
        for number in (2, 3, 1):
            began = _monotonic()
            self._attributes[6][termios.VMIN] = number
            termios.tcsetattr(self.descriptor, termios.TCSANOW, self._attributes)
            quickest = min(quickest, _monotonic() - began)
            fcntl.ioctl(self.descriptor, termios.TCGETS, self._record)
            records.append(bytes(self._record))
        # Systems differ in where it stands; it is what differs between a record with 2 and one with 3.
        places = (place for place, (two, three) in enumerate(zip(*records[:2], strict=True)) if (two, three) == (2, 3))
        self._vmin_at = next(places, -1)
        return quickest < _DEAR_S and self._vmin_at >= 0


def _gone(error: OSError) -> ChannelGoneError:
    if error.errno in _GONE:
        return ChannelGoneError(_GONE_TEXT)
    return ChannelGoneError(error.strerror or str(error))


def lock(descriptor: int) -> None:
    """Lock an open terminal until it is closed. Raises OSError when another program has."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def keep_others_out(descriptor: int) -> None:
    """Let no other program open the terminal, where the kernel can."""
    if not is_pseudo(descriptor):
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def let_others_in(descriptor: int) -> None:
    """Take that back; somebody else may have had the terminal open before, and would keep it marked."""
    with contextlib.suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
