"""A serial server with line settings (RFC 2217): drives hear the master with the settings that it sets."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

from drivecomm.protocol import LineSettings
from drivecomm.virtual.tcp_listener import TcpListener

# A subnegotiation of RFC 2217 has at most six bytes, and no signature needs to be longer than this.
_LONGEST_NEGOTIATION = 256


class Rfc2217Listener(TcpListener):
    """Telnet with RFC 2217 over TCP, for one master at a time."""

    scheme = "rfc2217"

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port)
        # A deferred import: pyserial is loaded only by modules that use a port.
        from serial.rfc2217 import PortManager

        self._negotiation: Any = PortManager
        self._line = PretendedPort()
        self._telnet: Any = None

    @property
    def settings(self) -> LineSettings | None:
        """The settings of the master; None until it sets any, which a plain telnet client never does."""
        return self._line.settings

    def send(self, data: bytes) -> None:
        """Send bytes to the master, escaped so that none reads as a telnet command."""
        if self._telnet is not None:
            super().send(b"".join(self._telnet.escape(data)))

    def write(self, data: bytes) -> None:
        """Send bytes of the negotiation itself; called by pyserial's side of it."""
        super().send(bytes(data))

    def _arrived(self) -> None:
        self._line = PretendedPort()
        self._telnet = self._negotiation(self._line, self)

    def _disconnect(self) -> None:
        self._telnet = None
        super()._disconnect()

    def _received(self, data: bytes) -> bytes:
        telnet = self._telnet
        try:
            characters = b"".join(telnet.filter(data))
        except (KeyError, TypeError, ValueError, struct.error):
            # pyserial's negotiation fails on commands that no RFC 2217 client sends.
            self._disconnect()
            return b""
        if telnet.suboption is not None and len(telnet.suboption) > _LONGEST_NEGOTIATION:
            self._disconnect()
            return b""
        return characters


class _Setting:
    """One line setting as an attribute for pyserial. Raises ValueError for a value that drives do not support."""

    def __set_name__(self, owner: type[PretendedPort], name: str) -> None:
        self._name = name

    def __get__(self, port: PretendedPort | None, owner: type[PretendedPort]) -> Any:
        return self if port is None else getattr(port.settings or LineSettings(), self._name)

    def __set__(self, port: PretendedPort, value: Any) -> None:
        port.settings = replace(port.settings or LineSettings(), **{self._name: value})


class PretendedPort:
    """The parts of a serial port that pyserial's server uses: adjustable line settings, fixed control lines."""

    baudrate, bytesize, parity, stopbits = _Setting(), _Setting(), _Setting(), _Setting()
    cts = dsr = cd = True
    ri = False

    def __init__(self) -> None:
        self.settings: LineSettings | None = None
        # pyserial may set these; they have no effect on a virtual line.
        self.xonxoff = self.rtscts = self.break_condition = False
        self.dtr = self.rts = True

    def reset_input_buffer(self) -> None:
        """Do nothing, because there is no input buffer."""

    def reset_output_buffer(self) -> None:
        """Do nothing, because there is no output buffer."""
