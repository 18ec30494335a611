"""Ports for listening only, which cannot send.

A terminal is opened read-only (O_RDONLY), so that the operating system itself refuses every write. RTS, which enables
the transmitter of simple RS-485 adapters, is switched off. On a serial server's raw connection (`socket://`) nothing is
sent. RFC 2217 is refused because it requires sending.

Two programs that read one terminal each get only a part of the bytes, so a port that another program has open is
refused.
"""

from __future__ import annotations

import array
import contextlib
import errno
import os
import sys
import time
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.transport.holders import holder_of_port
from drivecomm.transport.opening import cannot_open, error_number
from drivecomm.transport.port_names import is_pseudo
from drivecomm.transport.readiness import Readable
from drivecomm.transport.socket_channel import connect_to_serial_server

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

if sys.platform != "win32":
    import fcntl
    import termios

    from drivecomm.transport.tty_channel import keep_others_out, let_others_in, lock

_CHUNK = 4096
# Linux, asm-generic/termbits.h; termios has no name for it.
_STICK_PARITY = 0o10000000000
_ESCAPE, _SPOILT = 0xFF, 0x00


class ListeningPort(Protocol):
    """Port for listening. spoilt: number of characters received with a wrong parity or stop bit."""

    spoilt: int

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings; return a note on unsupported ones, "" if there are none. Raises PortError."""

    def read(self, until: float) -> bytes:
        """Return received bytes as soon as there are any; empty at `until`. Raises LinkDownError."""

    def now(self) -> float:
        """Return the time of the port's clock, in seconds."""

    def close(self) -> None:
        """Close the port."""


def listening_port(name: str, settings: LineSettings) -> ListeningPort:
    """Open a port exclusively for listening: the name of a terminal or `socket://HOST:PORT`.

    Raises PortError if it cannot be opened or another program uses it. Raises UsageError for a port on which listening
    requires sending.
    """
    if name.startswith("socket://"):
        return SocketListener(name)
    if "://" in name:
        raise UsageError(
            f"{name} cannot be listened to without sending; use the port's own name, or socket://HOST:PORT"
        )
    _refuse_on_windows(name)
    return TtyListener(name, settings)


def shared_listening_port(name: str, settings: LineSettings) -> ListeningPort:
    """Open a terminal for listening although another program uses it: each of the two gets a part of the bytes.

    Raises PortError if it cannot be opened, UsageError for a server's port.
    """
    if "://" in name:
        raise UsageError(f"{name} is shared by its server, or not at all; only a port of this machine can be shared")
    _refuse_on_windows(name)
    return SharedTtyListener(name, settings)


def _refuse_on_windows(name: str) -> None:
    if sys.platform == "win32":
        raise UsageError(f"{name} cannot be opened for listening only on Windows; use socket://HOST:PORT")


class TtyListener:
    """Terminal opened read-only.

    Characters with a wrong parity or stop bit are counted and still delivered: on a line with several formats, they are
    correct for other drives. A pseudo-terminal has neither parity nor stop bits.
    """

    def __init__(self, name: str, settings: LineSettings) -> None:
        self._name = name
        self.spoilt = 0
        self._marks, self._marked = MarkedCharacters(), False
        try:
            self.descriptor = os.open(name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise cannot_open(name, error) from error
        try:
            self._pseudo = is_pseudo(self.descriptor)
            self._take(settings)
        except BaseException:
            os.close(self.descriptor)
            raise
        self._readable = Readable(self.descriptor)

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings and discard earlier bytes. Raises PortError."""
        try:
            termios.tcsetattr(self.descriptor, termios.TCSANOW, self._attributes(settings))
            termios.tcflush(self.descriptor, termios.TCIOFLUSH)
        except termios.error as error:
            raise self._refused(settings, error) from error
        self._marks = MarkedCharacters()
        self._marked = not self._pseudo
        return "pseudo-terminal: settings are not carried, characters pass as they are" if self._pseudo else ""

    def read(self, until: float) -> bytes:
        """Return received bytes, see `ListeningPort`."""
        if not self._readable.wait(until):
            return b""
        try:
            data = os.read(self.descriptor, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone() from error
        if not data:
            raise self._gone()
        if not self._marked:
            return data
        plain, spoilt = self._marks.feed(data)
        self.spoilt += spoilt
        return plain

    def now(self) -> float:
        """Return the monotonic time, in seconds."""
        return time.monotonic()

    def close(self) -> None:
        """Close the port."""
        let_others_in(self.descriptor)
        os.close(self.descriptor)

    def _take(self, settings: LineSettings) -> None:
        """Lock the port and configure it."""
        try:
            lock(self.descriptor)
        except OSError as error:
            raise cannot_open(self._name, error) from error
        # Finds programs that use the port without a lock.
        if holder_of_port(self._name) is not None:
            raise cannot_open(self._name, OSError(errno.EBUSY, os.strerror(errno.EBUSY)))
        keep_others_out(self.descriptor)
        self.configure(settings)
        with contextlib.suppress(OSError):
            fcntl.ioctl(self.descriptor, termios.TIOCMBIC, array.array("i", [termios.TIOCM_RTS]))

    def _attributes(self, settings: LineSettings) -> list[Any]:
        attributes: list[Any] = termios.tcgetattr(self.descriptor)
        speed = getattr(termios, f"B{settings.baudrate}", None)
        if speed is None:
            raise UsageError(f"{self._name} cannot be listened to with {settings.baudrate} baud; use a standard rate")
        control = termios.CREAD | termios.CLOCAL | termios.CS8
        marking = 0
        if not self._pseudo:
            control = termios.CREAD | termios.CLOCAL | (termios.CS7 if settings.bytesize == 7 else termios.CS8)
            control |= _parity_flags(settings) | (termios.CSTOPB if settings.stopbits > 1 else 0)
            marking = termios.INPCK | termios.PARMRK
        characters = attributes[6]
        characters[termios.VMIN], characters[termios.VTIME] = 1, 0
        return [marking, 0, control, 0, speed, speed, characters]

    def _refused(self, settings: LineSettings, error: termios.error) -> PortError:
        if error_number(error) in (errno.ENOTTY, errno.ENODEV, errno.ENXIO):
            return cannot_open(self._name, error)
        return PortError(f"port {self._name} refuses {settings} ({error.args[-1]}); choose other line settings")

    def _gone(self) -> LinkDownError:
        return LinkDownError(f"port {self._name} is gone: it was unplugged, or its other end was closed")


class SharedTtyListener(TtyListener):
    """Terminal that another program uses as well; its settings stay. Each program gets a part of the bytes."""

    def configure(self, settings: LineSettings) -> str:
        """Change no settings; return a note that says so."""
        return f"shared: {settings} is not set, the other program's line settings hold"

    def close(self) -> None:
        """Close the port; exclusive mode set by the other program stays."""
        os.close(self.descriptor)

    def _take(self, settings: LineSettings) -> None:
        """Leave the port unlocked and unchanged."""


class SocketListener:
    """Connection to a serial server, used for receiving only; the server has its own line settings."""

    def __init__(self, url: str) -> None:
        self._url = url
        self.spoilt = 0
        self._socket, self._first = connect_to_serial_server(url)
        self._readable = Readable(self._socket.fileno())

    def configure(self, settings: LineSettings) -> str:
        """Change no settings; return a note that says so."""
        return f"raw TCP: {settings} is not carried, the server has its own line settings"

    def read(self, until: float) -> bytes:
        """Return received bytes, see `ListeningPort`."""
        if self._first:
            first, self._first = self._first, b""
            return first
        if not self._readable.wait(until):
            return b""
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkDownError(f"port {self._url}: the connection broke ({error.strerror or error})") from error
        if not data:
            raise LinkDownError(f"port {self._url}: the server closed the connection")
        return data

    def now(self) -> float:
        """Return the monotonic time, in seconds."""
        return time.monotonic()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class MarkedCharacters:
    """Decoder for the kernel's error marks in received bytes (termios, PARMRK).

    FFH 00H precedes a spoilt character; FFH FFH is a good FFH.
    """

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> tuple[bytes, int]:
        """Return the characters without marks, and the number of spoilt ones."""
        if not self._begun and _ESCAPE not in data:
            return data, 0
        data = self._begun + data
        plain, spoilt, place = bytearray(), 0, 0
        while place < len(data):
            if data[place] != _ESCAPE:
                length = 1
                plain.append(data[place])
            else:
                length = 3 if data[place + 1 : place + 2] == bytes([_SPOILT]) else 2
                if place + length > len(data):
                    break
                plain.append(data[place + length - 1])
                spoilt += length == 3
            place += length
        self._begun = data[place:]
        return bytes(plain), spoilt


def _parity_flags(settings: LineSettings) -> int:
    flags = 0 if settings.parity == "N" else termios.PARENB
    flags |= termios.PARODD if settings.parity in "OM" else 0
    return flags | (_STICK_PARITY if settings.parity in "MS" else 0)
