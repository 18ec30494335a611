"""Ports by pyserial's own read and write: rfc2217://, loop://, spy://, and all ports on Windows."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from serial import SerialBase, SerialException

from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError

if TYPE_CHECKING:
    from drivecomm.line import LineSettings

POLL_S = 0.005
"""How long one read of pyserial waits. It is never changed: over RFC 2217 that would negotiate the port anew."""


class PyserialChannel:
    """An open port of pyserial, of any kind."""

    # A write of Windows may return when the characters are out, so that their time cannot be told.
    paced = False

    def __init__(self, port: SerialBase) -> None:
        self._port: Any = port

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings without closing. Raises SettingsRefusedError."""
        try:
            set_at_once(self._port, settings)
        except (SerialException, ValueError) as error:
            if self._alive():
                raise SettingsRefusedError(str(error)) from error
            raise ChannelGoneError(_text(error)) from error
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error
        if getattr(self._port, "controls_unconfirmed", False):
            return "the server does not confirm control lines: flow control, DTR and RTS are as it leaves them"
        return ""

    def send(self, data: bytes, limit_s: float) -> None:  # noqa: ARG002 - pyserial has limits of its own here
        """Hand over all bytes."""
        try:
            while data:
                data = data[self._port.write(data) :]
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error

    def receive(self, wait_s: float, wanted: int) -> bytes:
        """Return what is there; wait a moment for this many bytes if that is nothing and there is time."""
        try:
            data: bytes = self._port.read(wanted) if wait_s > 0 else b""
            waiting = self._port.in_waiting
            return data + self._port.read(waiting) if waiting else data
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error

    def close(self) -> None:
        """Give the port back."""
        release(self._port)

    def _alive(self) -> bool:
        try:
            _ = self._port.in_waiting
        except OSError:
            return False
        # Over RFC 2217 a thread of pyserial reads, and ends with the connection.
        reader = getattr(self._port, "_thread", None)
        return reader is None or reader.is_alive()


def set_at_once(port: Any, settings: LineSettings, *, bytesize: int | None = None, parity: str | None = None) -> None:
    """Set all line settings of an open port in one step; bytesize and parity may differ from the settings'."""
    # pyserial's public setters each configure the whole port: four times 50 ms over RFC 2217, and on the way through
    # formats that nobody asked for and an adapter might refuse.
    port._baudrate = settings.baudrate  # noqa: SLF001
    port._bytesize = bytesize or settings.bytesize  # noqa: SLF001
    port._parity = parity or settings.parity  # noqa: SLF001
    port._stopbits = settings.stopbits  # noqa: SLF001
    port._reconfigure_port()  # noqa: SLF001


def release(port: Any) -> None:
    """Close a port of pyserial whatever state it is in; never raises."""
    with contextlib.suppress(Exception):
        port.close()


def _text(error: Exception) -> str:
    return str(error) or type(error).__name__
