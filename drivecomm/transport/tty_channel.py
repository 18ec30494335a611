"""Terminals of POSIX systems: pyserial opens and configures them, and bytes pass through the descriptor.

poll wakes as soon as enough bytes have arrived and costs a fifth of pyserial's read. Nothing waits until characters are
on the wire: the kernel checks that only every few milliseconds.
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
# Normally a change is a system call of some 3 us; with ftdi_sio, which sets the flow control, it is a USB message.
_DEAR_S = 100e-6
# Characters with a wrong parity or stop bit are dropped, so that their telegram is too short to be accepted. Otherwise
# they would be delivered unchanged or as NUL, and an exclusive-or check accepts one such telegram in 256.
_DROP_SPOILT = termios.INPCK | termios.IGNPAR

_monotonic = time.monotonic


class TtyChannel:
    """Open terminal: a real port, or a pseudo-terminal, which has no character format and so no parity.

    If that is cheap, the kernel wakes the reader only for a whole telegram (VMIN), otherwise for any byte.
    """

    def __init__(self, port: Serial) -> None:
        self._port: Any = port
        self.descriptor: int = port.fileno()
        keep_others_out(self.descriptor)
        self._pseudo = is_pseudo(self.descriptor)
        self._readable = Readable(self.descriptor)
        # Longer than necessary: with a short array Python releases its lock during the call and gets it back late.
        self._waiting = array.array("i", [0] * 512)
        # A buffer for the kernel's record of the attributes, longer than necessary for the same reason.
        # Setting the record is one system call; `tcsetattr` takes four.
        self._record = bytearray(2048)
        self._vmin_at = -1
        # With this, pyserial sets VMIN to 1 at every configuration, instead of 0.
        # With 0, an empty read would look like the end of the file.
        self._port.inter_byte_timeout = 0.0
        self._held = 1
        self._attributes: list[Any] = termios.tcgetattr(self.descriptor)
        self._set_input_flags(self._attributes[0] | _DROP_SPOILT)
        self._holds_back = sys.platform == "linux" and self._changes_quickly()

    @property
    def paced(self) -> bool:
        """Whether the port has a line speed; a pseudo-terminal has none."""
        return not self._pseudo

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings of the open port; return a note on unsupported ones. Raises SettingsRefusedError."""
        # A refusal is only reported if no other attribute changes together with the settings.
        self._set_input_flags(self._attributes[0] & ~_DROP_SPOILT)
        try:
            if self._pseudo:
                # On a pseudo-terminal, Linux refuses anything but 8N with EINVAL.
                set_at_once(self._port, settings, bytesize=8, parity="N")
            else:
                set_at_once(self._port, settings)
        except (OSError, ValueError, termios.error) as error:
            if error_number(error) in _GONE:
                raise ChannelGoneError(_GONE_TEXT) from error
            raise SettingsRefusedError(str(error)) from error
        finally:
            # Even after a refusal VMIN may have changed.
            self._reread_attributes()
            self._set_input_flags(self._attributes[0] | _DROP_SPOILT)
        if not self._pseudo or (settings.bytesize == 8 and settings.parity == "N"):
            return ""
        form = f"{settings.bytesize}{settings.parity}{settings.stopbits:g}"
        return f"pseudo-terminal: {form} is not carried, characters pass as they are"

    def send(self, data: bytes, limit_s: float) -> None:
        """Pass on all bytes within limit_s seconds."""
        try:
            if send_all(self._write, self.descriptor, data, limit_s):
                return
        except OSError as error:
            raise _gone(error) from error
        # Otherwise closing would wait for these bytes again, for up to half a minute.
        with contextlib.suppress(termios.error):
            termios.tcflush(self.descriptor, termios.TCOFLUSH)
        raise ChannelGoneError(f"it accepted no bytes for {limit_s:.0f} s")

    def receive(self, until: float, wanted: int) -> bytes:
        """Return the received bytes once there are `wanted` bytes, or at `until` whatever has arrived."""
        if until <= _monotonic():
            # Usually there are no bytes, and this check costs a third of an empty read.
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
        """Return the received bytes."""
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
        """Make the descriptor readable only for this many bytes, if the port changes VMIN cheaply."""
        at_least = max(1, min(at_least, _LONGEST_HOLD))
        if at_least == self._held or not self._holds_back:
            return
        try:
            self._hold(at_least)
        except OSError as error:
            raise _gone(error) from error

    def close(self) -> None:
        """Close the port; bytes already written are still sent."""
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
        # The position of VMIN differs between systems: it is the byte that changes from 2 to 3 between two records.
        places = (place for place, (two, three) in enumerate(zip(*records[:2], strict=True)) if (two, three) == (2, 3))
        self._vmin_at = next(places, -1)
        return quickest < _DEAR_S and self._vmin_at >= 0


def _gone(error: OSError) -> ChannelGoneError:
    if error.errno in _GONE:
        return ChannelGoneError(_GONE_TEXT)
    return ChannelGoneError(error.strerror or str(error))


def lock(descriptor: int) -> None:
    """Lock an open terminal until it is closed. Raises OSError if another program has locked it."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def keep_others_out(descriptor: int) -> None:
    """Set exclusive mode, so that no other program can open the terminal, if the kernel can."""
    if not is_pseudo(descriptor):
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def let_others_in(descriptor: int) -> None:
    """Clear exclusive mode; otherwise it stays while another program has had the terminal open before."""
    with contextlib.suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
