"""What systemd is told of this process: that it is ready, what it does, and that it does not hang.

The protocol is that of sd_notify(3): datagrams to the socket that $NOTIFY_SOCKET names. Without one nothing is sent.
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
    """Whoever started this process as a service, if anybody did.

    Sending never waits: what the socket does not take at once goes out with the next message. watchdog_s: within which
    time the manager wants to hear of this process again and again; None when it does not.
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
        """Say that the start or the reload is over."""
        self._send(READY="1", STATUS=_one_line(status))

    def status(self, text: str) -> None:
        """Say what `systemctl status` shows."""
        self._send(STATUS=_one_line(text))

    def reloading(self) -> None:
        """Say that the plant file is read again, until `ready`."""
        self._send(RELOADING="1", MONOTONIC_USEC=str(time.monotonic_ns() // 1000))

    def stopping(self, status: str) -> None:
        """Say that the end has begun."""
        self._send(STOPPING="1", STATUS=_one_line(status))

    async def feed_watchdog(self) -> None:
        """Say again and again, from within the event loop, that it runs: one that hangs is noticed."""
        while self.watchdog_s is not None:
            self._send(WATCHDOG="1")
            await asyncio.sleep(self.watchdog_s / 3)

    def close(self) -> None:
        """Send nothing any more."""
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
