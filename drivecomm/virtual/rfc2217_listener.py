"""A serial server with line settings (RFC 2217): what a master sets is what the drives hear it with."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

from drivecomm.protocol import LineSettings
from drivecomm.virtual.tcp_listener import TcpListener

# A subnegotiation of RFC 2217 has six bytes at most, and a signature that nobody needs longer than this.
_LONGEST_NEGOTIATION = 256


class Rfc2217Listener(TcpListener):
    """Telnet with RFC 2217 over TCP, for one master after the other."""

    scheme = "rfc2217"

    def __init__(self, host: str, port: int) -> None:
        super().__init__(host, port)
        # Only what touches a port loads pyserial when it is imported.
        from serial.rfc2217 import PortManager

        self._negotiation: Any = PortManager
        self._line = PretendedPort()
        self._telnet: Any = None

    @property
    def settings(self) -> LineSettings | None:
        """What the master has set; None as long as it has set nothing, as a plain telnet client never does."""
        return self._line.settings

    def send(self, data: bytes) -> None:
        """Send to the master, protected from being taken for a telnet command."""
        if self._telnet is not None:
            super().send(b"".join(self._telnet.escape(data)))

    def write(self, data: bytes) -> None:
        """Send what the negotiation itself has to say; its side calls this."""
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
            # pyserial's side of the negotiation stumbles over commands that no client of RFC 2217 sends.
            self._disconnect()
            return b""
        if telnet.suboption is not None and len(telnet.suboption) > _LONGEST_NEGOTIATION:
            self._disconnect()
            return b""
        return characters


class _Setting:
    """One of the line settings, as pyserial gets and sets it; one that drives do not have is a ValueError."""

    def __set_name__(self, owner: type[PretendedPort], name: str) -> None:
        self._name = name

    def __get__(self, port: PretendedPort | None, owner: type[PretendedPort]) -> Any:
        return self if port is None else getattr(port.settings or LineSettings(), self._name)

    def __set__(self, port: PretendedPort, value: Any) -> None:
        port.settings = replace(port.settings or LineSettings(), **{self._name: value})


class PretendedPort:
    """What pyserial's server side needs of a serial port: line settings that can be set, control lines that cannot."""

    baudrate, bytesize, parity, stopbits = _Setting(), _Setting(), _Setting(), _Setting()
    cts = dsr = cd = True
    ri = False

    def __init__(self) -> None:
        self.settings: LineSettings | None = None
        # Taken and of no consequence on a virtual line.
        self.xonxoff = self.rtscts = self.break_condition = False
        self.dtr = self.rts = True

    def reset_input_buffer(self) -> None:
        """Nothing is kept back here."""

    def reset_output_buffer(self) -> None:
        """Nothing is kept back here."""
