"""Ports through the read and write functions of pyserial: rfc2217://, loop://, spy://, and all ports on Windows."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any

from serial import SerialBase, SerialException

from drivecomm.transport.channel import ChannelGoneError, SettingsRefusedError

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings

POLL_S = 0.005
"""Timeout in seconds of one pyserial read. It never changes: over RFC 2217 that would renegotiate the port."""


class PyserialChannel:
    """Open port of pyserial, of any kind."""

    # On Windows a write may return after the characters are sent, so their time is unknown.
    paced = False
    # Over RFC 2217 a thread reads, Windows waits for handles, and loop:// is a queue: none has a descriptor.
    descriptor = None

    def __init__(self, port: SerialBase) -> None:
        self._port: Any = port

    def apply(self, settings: LineSettings) -> str:
        """Set the line settings of the open port; return a note on unsupported ones. Raises SettingsRefusedError."""
        try:
            set_at_once(self._port, settings)
        except (SerialException, ValueError) as error:
            if self._alive():
                raise SettingsRefusedError(str(error)) from error
            raise ChannelGoneError(_text(error)) from error
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error
        if getattr(self._port, "controls_unconfirmed", False):
            return "the server does not confirm control lines: flow control, DTR and RTS keep its settings"
        return ""

    def send(self, data: bytes, limit_s: float) -> None:  # noqa: ARG002 - pyserial has limits of its own here
        """Pass on all bytes."""
        try:
            while data:
                data = data[self._port.write(data) :]
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error

    def receive(self, until: float, wanted: int) -> bytes:
        """Return the received bytes once there are `wanted` bytes, or up to 5 ms after `until` whatever has arrived."""
        data = b""
        try:
            while time.monotonic() < until:
                data += self._port.read(wanted - len(data))
                if len(data) >= wanted:
                    break
            return data + self.take()
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error

    def take(self) -> bytes:
        """Return the received bytes."""
        try:
            waiting = self._port.in_waiting
            data: bytes = self._port.read(waiting) if waiting else b""
        except OSError as error:
            raise ChannelGoneError(_text(error)) from error
        return data

    def hold_back(self, at_least: int) -> None:
        """Do nothing, because there is no descriptor."""

    def close(self) -> None:
        """Close the port."""
        release(self._port)

    def _alive(self) -> bool:
        try:
            _ = self._port.in_waiting
        except OSError:
            return False
        # Over RFC 2217 a thread of pyserial reads; it ends with the connection.
        reader = getattr(self._port, "_thread", None)
        return reader is None or reader.is_alive()


def set_at_once(port: Any, settings: LineSettings, *, bytesize: int | None = None, parity: str | None = None) -> None:
    """Set all line settings of an open port in one step. bytesize, parity: override those of the settings."""
    # Each public setter of pyserial configures the whole port: four times 50 ms over RFC 2217, with intermediate
    # formats that were not requested and that an adapter might refuse.
    port._baudrate = settings.baudrate  # noqa: SLF001
    port._bytesize = bytesize or settings.bytesize  # noqa: SLF001
    port._parity = parity or settings.parity  # noqa: SLF001
    port._stopbits = settings.stopbits  # noqa: SLF001
    port._reconfigure_port()  # noqa: SLF001


def release(port: Any) -> None:
    """Close a pyserial port in any state; never raises."""
    with contextlib.suppress(Exception):
        port.close()


def _text(error: Exception) -> str:
    return str(error) or type(error).__name__
