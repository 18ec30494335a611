"""Notifications to systemd: ready, status, and the watchdog.

The protocol is that of sd_notify(3): datagrams to the socket that $NOTIFY_SOCKET names. Without that variable nothing
is sent.
"""

from __future__ import annotations

import asyncio
import os
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


class ServiceManager:
    """The service manager that started this process, if any.

    Sending never waits: a notification that the socket does not take immediately goes out with the next one.
    watchdog_s: interval in seconds within which the manager expects watchdog notifications; None if it expects none.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self.watchdog_s = _watchdog_s(environment)
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._unsent: dict[str, str] = {}
        self._socket: socket.socket | None = None
        if self._address.startswith(("/", "@")) and hasattr(socket, "AF_UNIX"):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    def ready(self, status: str) -> None:
        """Notify systemd that the start or the reload has finished."""
        self._send(READY="1", STATUS=_one_line(status))

    def status(self, text: str) -> None:
        """Set the text that `systemctl status` shows."""
        self._send(STATUS=_one_line(text))

    def reloading(self) -> None:
        """Notify systemd that the plant file is being read again, until `ready` follows."""
        self._send(RELOADING="1", MONOTONIC_USEC=str(time.monotonic_ns() // 1000))

    def stopping(self, status: str) -> None:
        """Notify systemd that shutdown has begun."""
        self._send(STOPPING="1", STATUS=_one_line(status))

    async def feed_watchdog(self) -> None:
        """Send watchdog notifications from within the event loop, so that systemd notices if the loop hangs."""
        while self.watchdog_s is not None:
            self._send(WATCHDOG="1")
            await asyncio.sleep(self.watchdog_s / 3)

    def close(self) -> None:
        """Close the socket; later notifications are not sent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, **assignments: str) -> None:
        if self._socket is None:
            return
        self._unsent |= assignments
        text = "\n".join(f"{name}={value}" for name, value in self._unsent.items())
        address = f"\0{self._address[1:]}" if self._address[0] == "@" else self._address
        with suppress(OSError):
            self._socket.sendto(text.encode(), address)
            self._unsent = {}


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    asked = environment.get("WATCHDOG_USEC", "")
    meant = environment.get("WATCHDOG_PID", "")
    if not asked.isdecimal() or int(asked) == 0 or (meant and meant != str(os.getpid())):
        return None
    return int(asked) / 1e6


def _one_line(text: str) -> str:
    return " ".join(text.split())
