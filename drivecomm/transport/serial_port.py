"""A serial port of this machine or of a server on the network, by the URLs of pyserial.

/dev/ttyUSB0, COM3          a port of this machine
socket://HOST:PORT          raw bytes over TCP; the line settings are the server's affair
modbus-tcp://HOST:PORT      Modbus over TCP, to a drive on Ethernet or a gateway; port 502 unless given
rfc2217://HOST:PORT         a serial server that takes line settings as well
loop://                     what is sent comes back
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
from drivecomm.transport.alarm import open_alarm
from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError
from drivecomm.transport.opening import cannot_open
from drivecomm.transport.port_names import ONE_PROTOCOL, scheme_of, stable_name
from drivecomm.transport.pyserial_channel import POLL_S, PyserialChannel, release

if TYPE_CHECKING:
    from drivecomm.transport.alarm import Alarm
    from drivecomm.transport.channel import Channel
    from drivecomm.transport.port_report import PortReport

# Beyond the time that the characters need on the wire: who takes none for so long will not take them at all.
_STUCK_S = 3.0


class SerialPort:
    """The port with this URL or name, opened for this program alone where the platform can.

    rs485: let the driver switch the transmitter, for adapters that do not do it themselves. low_latency: whether a USB
    adapter shall hand bytes over at once; None does so where it can be set, False leaves it as it is. Both are for
    ports of this machine.

    Raises PortError, in one sentence with cause and remedy, when it cannot be opened or has not what was asked for, and
    UsageError when no port with such a URL has it.
    """

    real_time = True

    def __init__(self, url: str, *, rs485: bool = False, low_latency: bool | None = None) -> None:
        if "://" in url and (rs485 or low_latency):
            what = "rs485" if rs485 else "low_latency"
            raise UsageError(
                f"{what} is for ports of this machine, and {url} is none; set it up at its server", says=what
            )
        self.url = url
        self.stable_name = stable_name(url)
        """What to open the port by when it was lost: follows the adapter, where the system has such a name."""
        self._port, self._channel = _open(url, rs485=rs485, low_latency=low_latency)
        self.descriptor = self._channel.descriptor
        """Readable when bytes are there or the port has gone; None when there is nothing to select on."""
        self._two_characters_s = 2 * LineSettings().character_s
        self._alarm: Alarm | None = None
        self._alarm_opened = False
        self._alarm_in_use = threading.Lock()

    @property
    def paced(self) -> bool:
        """Whether characters take their time: on a port of this machine that is no pseudo-terminal."""
        return self._channel.paced

    # The monotonic clock, in seconds; not a method of its own, which would cost as much again.
    now = staticmethod(time.monotonic)

    # The seconds since 1970, likewise.
    wall_time = staticmethod(time.time)

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
        self._two_characters_s = 2 * settings.character_s
        return note

    def write(self, data: bytes) -> None:
        """Hand over bytes for sending; does not wait for the wire. Raises LinkDownError when nobody takes them."""
        try:
            self._channel.send(data, _STUCK_S + self._two_characters_s * len(data))
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def read(self, until: float, at_least: int) -> bytes:
        """Return all bytes that are there as soon as there are this many, at `until` with what there is."""
        try:
            return self._channel.receive(until, at_least if at_least > 0 else 1)
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def take(self) -> bytes:
        """Return the bytes that are there; never waits. Raises LinkDownError when the other end has gone."""
        try:
            return self._channel.take()
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def hold_back(self, at_least: int) -> None:
        """Make the descriptor readable only for so many bytes, where the system can; `take` still takes fewer."""
        try:
            self._channel.hold_back(at_least)
        except ChannelGoneError as error:
            raise self._lost(error) from error

    def wait(self, until: float) -> None:
        """Let time pass until then, to some microseconds where the system can; never less."""
        # Threads that wait outside their turn do so at the same time, and the alarm is for one of them.
        if self._alarm_in_use.acquire(blocking=False):
            try:
                if not self._alarm_opened:
                    self._alarm_opened, self._alarm = True, open_alarm()
                if self._alarm is not None:
                    self._alarm.wait(until)
                    return
            finally:
                self._alarm_in_use.release()
        # Some platforms sleep a little less than asked.
        while (left := until - time.monotonic()) > 0:
            time.sleep(left)

    def report(self) -> PortReport:
        """Return what is known of the port, for people."""
        # It looks through all ports of the machine, for which only those who ask load the means.
        from drivecomm.transport.port_report import local_report, remote_report

        if "://" in self.url:
            return remote_report(self.url)
        pseudo = os.name == "posix" and not self._channel.paced
        return local_report(self._port, self.url, pseudo=pseudo)

    def close(self) -> None:
        """Give the port back."""
        self._channel.close()
        if self._alarm is not None:
            self._alarm.close()
        self._alarm, self._alarm_opened = None, True

    def _lost(self, error: ChannelGoneError) -> LinkDownError:
        return LinkDownError(f"port {self.url} was lost ({error}); the next exchange opens it again")


def _open(url: str, *, rs485: bool, low_latency: bool | None) -> tuple[Any, Channel]:
    """Return pyserial's port, None for a socket, and the channel to it."""
    if (scheme := scheme_of(url)) == "socket" or scheme in ONE_PROTOCOL:
        from drivecomm.transport.socket_channel import SocketChannel

        return None, SocketChannel(url)
    # A port of Windows has no other limit for a write than its own.
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
            # pyserial's RFC 2217 client starts its thread by a name that Python gives up.
            warnings.simplefilter("ignore", DeprecationWarning)
            port.open()
        if type(port) is serial.Serial:
            _set_up(port, url, rs485=rs485, low_latency=low_latency)
        if type(port) is serial.Serial and os.name == "posix":
            # Its module needs termios, which Windows does not have.
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
        latency.require_low(port, name)
    elif low_latency is None:
        latency.make_low(port, name)
