"""pyserial's RFC 2217 client, made to live with real servers and with changing line settings."""

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
# The server has confirmed the line settings by then, so it is there and answers what it knows.
_CONTROL_S = 1.0


class Rfc2217Client(Serial):
    """A port of a serial server.

    Other than its base it sends only the settings that change and waits for their confirmation no longer than it takes
    (50 ms and more otherwise, at each change from one drive to another), it does not insist on control lines, and its
    reading thread ends without a traceback when the connection breaks.
    """

    # What its base has and its type stubs do not tell.
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
        """Close the port; its base forgets the socket when the other end has gone first."""
        connection = self._socket
        super().close()
        if connection is not None:
            connection.close()

    def rfc2217_set_control(self, value: bytes) -> None:
        """Ask for a control line; a server that has none may leave that unanswered, or refuse."""
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
        # An item's `active` raises ValueError when the server has answered with another value.
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
            # The connection broke while the thread was answering; readers notice that it has ended.
            self._read_buffer.put(None)
        self._hung_up = True
        for option in self._telnet_options or ():
            # Opening waits for these, and would do so for 3 s although nobody is there to agree any more.
            option.active = option.state != _INACTIVE
