"""Places where other programs connect to virtual drives: `pty:PATH`, `tcp:HOST:PORT`, `rfc2217:HOST:PORT`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import LineSettings

_FORMS = "pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT"


class Listener(Protocol):
    """The master's end of a line that is served. Used by one thread only."""

    @property
    def address(self) -> str:
        """The address that a master opens; final once the listener is open."""
        ...

    @property
    def settings(self) -> LineSettings | None:
        """The line settings of the master; None if the connection carries none, or the master has set none."""
        ...

    @property
    def descriptor(self) -> int | None:
        """The descriptor to watch for a master that connects or sends; None when closed. It changes with the master."""
        ...

    def open(self) -> None:
        """Open the listener for connections.

        Raises PortError, with a one-sentence message, if the place is not available.
        """
        ...

    def receive(self, wait_s: float) -> bytes:
        """Return bytes from a master, after waiting up to `wait_s` seconds.

        Returns early with no bytes when a master connects or disconnects.
        """
        ...

    def send(self, data: bytes) -> None:
        """Send bytes to the master, if there is one; never blocks. Bytes that do not fit are lost, as on a line."""
        ...

    def close(self) -> None:
        """Release everything; may be called again."""
        ...


@runtime_checkable
class ShowsSettings(Protocol):
    """A listener that shows some of the master's line settings although it cannot carry all (`settings` is None)."""

    @property
    def told_settings(self) -> Mapping[str, Any]:
        """The visible line settings by name; empty if the master has set none."""
        ...


@runtime_checkable
class OverhearingListener(Protocol):
    """A listener with read-only clients that hear the whole line."""

    def overhear(self, data: bytes) -> None:
        """Send bytes from the line to all read-only clients; never blocks."""
        ...


def parse_shared_listen(text: str) -> Listener:
    """Return the listener for `tcp:HOST:PORT` with read-only clients beside the master. Raises UsageError."""
    kind, _, rest = text.partition(":")
    if kind != "tcp":
        raise UsageError(f"a line at {text!r} can have no listeners; let it listen at tcp:HOST:PORT")
    from drivecomm.virtual.shared_tcp_listener import SharedTcpListener

    return SharedTcpListener(*_host_and_port(text, rest))


def parse_listen(text: str) -> Listener:
    """Return the listener for `pty:PATH`, `tcp:HOST:PORT` or `rfc2217:HOST:PORT`, not yet open.

    Without a host, only programs on this machine can connect; port 0 takes any free port. Raises UsageError.
    """
    kind, _, rest = text.partition(":")
    if kind == "pty":
        if not rest:
            raise UsageError(f"{text!r} names no path for the pseudo-terminal; write pty:PATH")
        if os.name != "posix":
            raise UsageError("this system has no pseudo-terminals; listen at tcp:HOST:PORT instead")
        from drivecomm.virtual.pty_listener import PtyListener

        return PtyListener(rest)
    if kind == "tcp":
        from drivecomm.virtual.tcp_listener import TcpListener

        return TcpListener(*_host_and_port(text, rest))
    if kind == "rfc2217":
        from drivecomm.virtual.rfc2217_listener import Rfc2217Listener

        return Rfc2217Listener(*_host_and_port(text, rest))
    raise UsageError(f"cannot listen at {text!r}; write {_FORMS}")


def _host_and_port(text: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise UsageError(f"{text!r} names no port number from 0 to 65535; write {_FORMS}")
    return host or "127.0.0.1", int(port)
