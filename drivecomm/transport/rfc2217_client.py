"""pyserial's RFC 2217 client, adapted to real servers and to frequent changes of line settings."""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING, Any

from serial import SerialException
from serial.rfc2217 import (
    RFC2217_PARITY_MAP,
    RFC2217_STOPBIT_MAP,
    SET_CONTROL_USE_NO_FLOW_CONTROL,
    Serial,
)

from drivecomm.transport.opening import HungUpError

if TYPE_CHECKING:
    from queue import Queue
    from socket import socket
    from threading import Thread

_ACTIVE, _INACTIVE = "ACTIVE", "INACTIVE"
_LOOK_S = 0.001
# Short, because the server is known to respond: it has already confirmed the line settings.
_CONTROL_S = 1.0


class Rfc2217Client(Serial):
    """Port of a serial server.

    Unlike its base, it sends only changed settings and waits for their confirmation no longer than necessary; the base
    takes 50 ms or more at each change from one drive to another. It does not insist on control lines, and its reading
    thread ends without a traceback when the connection breaks.
    """

    # Attributes of the base that are missing from its type stubs.
    _baudrate: int
    _bytesize: int
    _parity: str
    _stopbits: float
    _thread: Thread
    _socket: socket | None
    _network_timeout: float
    _read_buffer: Queue[bytes | None]
    _ignore_set_control_answer: bool
    _rfc2217_port_settings: dict[str, Any]
    _rfc2217_options: dict[str, Any]
    _telnet_options: list[Any] | None

    def __init__(self, *args: Any, **options: Any) -> None:
        self.controls_unconfirmed = False
        """The server did not confirm a control line or the absence of flow control."""
        self._flow_settled = self._hung_up = False
        super().__init__(*args, **options)

    def close(self) -> None:
        """Close the port and its socket, which the base leaks if the other end has closed first."""
        connection = self._socket
        super().close()
        if connection is not None:
            connection.close()

    def rfc2217_set_control(self, value: bytes) -> None:
        """Request a control line; a server without it may refuse or not respond."""
        item = self._rfc2217_options["control"]
        item.set(value)
        if self.controls_unconfirmed or self._ignore_set_control_answer:
            return
        try:
            self._confirmed([item], _CONTROL_S)
        except (SerialException, ValueError):
            self.controls_unconfirmed = True

    def _reconfigure_port(self) -> None:
        if self._hung_up and not self._flow_settled:
            raise HungUpError(self._come_by_now())
        wanted = {
            "baudrate": struct.pack("!I", self._baudrate),
            "datasize": struct.pack("!B", self._bytesize),
            "parity": struct.pack("!B", RFC2217_PARITY_MAP[self._parity]),
            "stopsize": struct.pack("!B", RFC2217_STOPBIT_MAP[self._stopbits]),
        }
        items = self._rfc2217_port_settings
        asked = [name for name, value in wanted.items() if items[name].value != value or items[name].state != _ACTIVE]
        for name in asked:
            items[name].set(wanted[name])
        self._confirmed([items[name] for name in asked], self._network_timeout)
        if not self._flow_settled:
            self.rfc2217_set_control(SET_CONTROL_USE_NO_FLOW_CONTROL)
            self._flow_settled = True

    def _confirmed(self, items: list[Any], limit_s: float) -> None:
        until = time.monotonic() + limit_s
        # An item's `active` raises ValueError if the server has answered with another value.
        while not all(item.active for item in items):
            if time.monotonic() > until or not self._thread.is_alive():
                raise SerialException("the server does not confirm line settings")
            time.sleep(_LOOK_S)

    def _come_by_now(self) -> bytes:
        come = []
        while not self._read_buffer.empty():
            come.append(self._read_buffer.get_nowait() or b"")
        return b"".join(come)

    def _telnet_read_loop(self) -> None:
        try:
            super()._telnet_read_loop()  # type: ignore[misc]
        except OSError:
            # The connection broke while the thread was responding; `None` tells readers that the thread has ended.
            self._read_buffer.put(None)
        self._hung_up = True
        for option in self._telnet_options or ():
            # Opening would wait 3 s for these options, although no response can arrive any more.
            option.active = option.state != _INACTIVE
