"""A serial port of this machine or of a network server, selected by a pyserial URL.

/dev/ttyUSB0, COM3          a local port
socket://HOST:PORT          raw bytes over TCP; the server has its own line settings
modbus-tcp://HOST:PORT      Modbus over TCP, to a drive on Ethernet or a gateway; default port 502
rfc2217://HOST:PORT         a serial server that also accepts line settings
loop://                     returns what is sent
"""

from __future__ import annotations

import os
import threading
import time
import warnings
from typing import TYPE_CHECKING, Any

import serial

from drivecomm.errors import DriveCommError, LinkDownError, PortError, UsageError
from drivecomm.protocol import LineSettings
from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError
from drivecomm.transport.kernel_timer import open_timer
from drivecomm.transport.opening import cannot_open
from drivecomm.transport.port_names import ONE_PROTOCOL, scheme_of, stable_name
from drivecomm.transport.pyserial_channel import POLL_S, PyserialChannel, release

if TYPE_CHECKING:
    from drivecomm.transport.channel import Channel
    from drivecomm.transport.kernel_timer import KernelTimer
    from drivecomm.transport.port_report import PortReport

# In addition to the time on the wire; a port that accepts no bytes for this long is stuck.
_STUCK_S = 3.0


class SerialPort:
    """Port with this URL or name, opened exclusively if the platform can.

    rs485: the driver switches the transmitter, for adapters that do not do so themselves. low_latency: whether a USB
    adapter must pass bytes on immediately; None requests it where possible, False changes nothing. Both apply to local
    ports only.

    Raises PortError, in one sentence with cause and remedy, if the port cannot be opened or lacks a requested feature.
    Raises UsageError for a feature that no port with such a URL has.
    """

    real_time = True

    def __init__(self, url: str, *, rs485: bool = False, low_latency: bool | None = None) -> None:
        if "://" in url and (rs485 or low_latency):
            what = "rs485" if rs485 else "low_latency"
            raise UsageError(
                f"{what} is for ports of this machine, and {url} is not one; set it up at its server", says=what
            )
        self.url = url
        self.stable_name = stable_name(url)
        """Name for reopening a lost port, which follows the adapter if the system has such a name."""
        self._port, self._channel = _open(url, rs485=rs485, low_latency=low_latency)
        self.descriptor = self._channel.descriptor
        """Readable when bytes have arrived or the port is gone; None if the port has no descriptor."""
        self._two_characters_s = 2 * LineSettings().character_s
        self._alarm: KernelTimer | None = None
        self._alarm_opened = False
        self._alarm_in_use = threading.Lock()

    @property
    def paced(self) -> bool:
        """Whether characters are sent at line speed: on local ports except pseudo-terminals."""
        return self._channel.paced

    # Monotonic time in seconds; a method of its own would take twice as long.
    now = staticmethod(time.monotonic)

    # Seconds since 1970; not a method for the same reason.
    wall_time = staticmethod(time.time)

    def configure(self, settings: LineSettings) -> str:
        """Set the line settings of the open port; return a note on those that the port does not support.

        Raises PortError if the port refuses supported settings.
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
        self._two_characters_s = 2 * settings.character_s
        return note

    def write(self, data: bytes) -> None:
        """Pass bytes on for sending, without waiting for the wire. Raises LinkDownError if they are not accepted."""
        try:
            self._channel.send(data, _STUCK_S + self._two_characters_s * len(data))
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def read(self, until: float, at_least: int) -> bytes:
        """Return all received bytes once there are `at_least` bytes, or at `until` whatever has arrived."""
        try:
            return self._channel.receive(until, at_least if at_least > 0 else 1)
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def take(self) -> bytes:
        """Return the received bytes without waiting. Raises LinkDownError if the other end is gone."""
        try:
            return self._channel.take()
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for this many bytes if the system can; `take` still returns fewer."""
        try:
            self._channel.hold_back(at_least)
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def wait(self, until: float) -> None:
        """Wait until this time; never returns earlier, and only microseconds later if the system can."""
        # Threads outside their turn may wait concurrently, and the timer serves only one of them.
        if self._alarm_in_use.acquire(blocking=False):
            try:
                if not self._alarm_opened:
                    self._alarm_opened, self._alarm = True, open_timer()
                if self._alarm is not None:
                    self._alarm.wait(until)
                    return
            finally:
                self._alarm_in_use.release()
        # Some platforms sleep slightly less than requested.
        while (left := until - time.monotonic()) > 0:
            time.sleep(left)

    def report(self) -> PortReport:
        """Return a report on the port, for people."""
        # Imported only here, because the report needs modules that list all ports of the machine.
        from drivecomm.transport.port_report import local_report, remote_report

        if "://" in self.url:
            return remote_report(self.url)
        pseudo = os.name == "posix" and not self._channel.paced
        return local_report(self._port, self.url, pseudo=pseudo)

    def close(self) -> None:
        """Close the port."""
        self._channel.close()
        if self._alarm is not None:
            self._alarm.close()
        self._alarm, self._alarm_opened = None, True

    def _lost(self, error: ChannelGoneError) -> LinkDownError:
        return LinkDownError(f"port {self.url} was lost ({error}); the next exchange opens it again")


def _open(url: str, *, rs485: bool, low_latency: bool | None) -> tuple[Any, Channel]:
    """Return pyserial's port, None for a socket, and its channel."""
    if (scheme := scheme_of(url)) == "socket" or scheme in ONE_PROTOCOL:
        from drivecomm.transport.socket_channel import SocketChannel

        return None, SocketChannel(url)
    # Writes on Windows have no other time limit than that of the port.
    write_timeout = _STUCK_S if os.name == "nt" and "://" not in url else None
    try:
        if url.lower().startswith("rfc2217://"):
            from drivecomm.transport.rfc2217_client import Rfc2217Client

            port: Any = Rfc2217Client(None, timeout=POLL_S)
            port.port = url
        else:
            port = serial.serial_for_url(
                url, do_not_open=True, exclusive=True, timeout=POLL_S, write_timeout=write_timeout
            )
    except Exception as error:
        raise cannot_open(url, error) from error
    try:
        with warnings.catch_warnings():
            # pyserial's RFC 2217 client uses a deprecated name to start its thread.
            warnings.simplefilter("ignore", DeprecationWarning)
            port.open()
        if type(port) is serial.Serial:
            _set_up(port, url, rs485=rs485, low_latency=low_latency)
        if type(port) is serial.Serial and os.name == "posix":
            # This module needs termios, which Windows does not have.
            from drivecomm.transport.tty_channel import TtyChannel

            return port, TtyChannel(port)
        return port, PyserialChannel(port)
    except BaseException as error:
        release(port)
        if isinstance(error, Exception) and not isinstance(error, DriveCommError):
            raise cannot_open(url, error) from error
        raise


def _set_up(port: Any, name: str, *, rs485: bool, low_latency: bool | None) -> None:
    from drivecomm.transport import direction, latency

    if rs485:
        direction.switch_on(port, name)
    if low_latency:
        latency.require_low_latency(port, name)
    elif low_latency is None:
        latency.enable_low_latency(port, name)
