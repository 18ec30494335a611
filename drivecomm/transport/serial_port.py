"""A serial port of this machine or of a server on the network, by the URLs of pyserial.

/dev/ttyUSB0, COM3          a port of this machine
socket://HOST:PORT          raw bytes over TCP; the line settings are the server's affair
rfc2217://HOST:PORT         a serial server that takes line settings as well
loop://                     what is sent comes back
"""

from __future__ import annotations

import os
import time
import warnings
from typing import TYPE_CHECKING, Any

import serial

from drivecomm.errors import LinkDownError, PortError
from drivecomm.line import LineSettings
from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError
from drivecomm.transport.opening import cannot_open
from drivecomm.transport.pyserial_channel import POLL_S, PyserialChannel, release
from drivecomm.transport.rfc2217_client import Rfc2217Client
from drivecomm.transport.socket_channel import SocketChannel

if TYPE_CHECKING:
    from drivecomm.transport.channel import Channel

# Beyond the time that the characters need on the wire: who takes none for so long will not take them at all.
_STUCK_S = 3.0


class SerialPort:
    """The port with this URL or name, opened for this program alone where the platform can.

    Raises PortError, in one sentence with cause and remedy, when it cannot be opened.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._settings = LineSettings()
        self._channel = _open(url)

    @property
    def paced(self) -> bool:
        """Whether characters take their time: on a port of this machine that is no pseudo-terminal."""
        return self._channel.paced

    def now(self) -> float:
        """Return the monotonic clock's time."""
        return time.monotonic()

    def wall_time(self) -> float:
        """Return the seconds since 1970."""
        return time.time()

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings of the open port; return a note when the port cannot carry all of them.

        Raises PortError when it could carry them and refuses.
        """
        try:
            note = self._channel.apply(settings)
        except SettingsRefusedError as error:
            raise PortError(
                f"port {self.url} refuses the line settings {settings} ({error}); "
                "use an adapter that can, or give settings that it and the drive have in common"
            ) from error
        except ChannelGoneError as error:
            raise self._lost(error) from error
        self._settings = settings
        return note

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending; does not wait for the wire. Raises LinkDownError when nobody takes them."""
        try:
            self._channel.send(data, _STUCK_S + 2 * self._settings.wire_s(len(data)))
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def read(self, until: float, at_least: int) -> bytes:
        """Return all bytes that are there as soon as there are this many, at `until` with what there is."""
        data = b""
        try:
            while True:
                left = until - time.monotonic()
                data += self._channel.receive(max(0.0, left), max(1, at_least - len(data)))
                if len(data) >= at_least or left <= 0:
                    return data
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def wait(self, until: float) -> None:
        """Sleep until then."""
        # Some platforms sleep a little less than asked.
        while (left := until - time.monotonic()) > 0:
            time.sleep(left)

    def close(self) -> None:
        """Give the port back."""
        self._channel.close()

    def _lost(self, error: ChannelGoneError) -> LinkDownError:
        return LinkDownError(f"port {self.url} was lost ({error}); the next exchange opens it again")


def _open(url: str) -> Channel:
    if url.lower().startswith("socket://"):
        return SocketChannel(url)
    # A port of Windows has no other limit for a write than its own.
    write_timeout = _STUCK_S if os.name == "nt" and "://" not in url else None
    try:
        if url.lower().startswith("rfc2217://"):
            port: Any = Rfc2217Client(None, timeout=POLL_S)
            port.port = url
        else:
            port = serial.serial_for_url(
                url, do_not_open=True, exclusive=True, timeout=POLL_S, write_timeout=write_timeout
            )
    except (ValueError, OSError) as error:
        raise cannot_open(url, error) from error
    try:
        with warnings.catch_warnings():
            # pyserial's RFC 2217 client starts its thread by a name that Python gives up.
            warnings.simplefilter("ignore", DeprecationWarning)
            port.open()
        if type(port) is serial.Serial and os.name == "posix":
            # Its module needs termios, which Windows does not have.
            from drivecomm.transport.tty_channel import TtyChannel  # noqa: PLC0415

            return TtyChannel(port)
        return PyserialChannel(port)
    except BaseException as error:
        release(port)
        if isinstance(error, (OSError, ValueError)) or type(error).__module__ == "termios":
            raise cannot_open(url, error) from error
        raise
