"""Error messages for ports that cannot be opened: the cause and the remedy in one sentence."""

from __future__ import annotations

import errno
import os
import re
import socket
import stat
from urllib.parse import urlsplit

from drivecomm.errors import PortError
from drivecomm.transport.port_names import ONE_PROTOCOL

_ABSENT = frozenset({errno.ENOENT, errno.ENOTDIR})
_EMPTY = frozenset({errno.ENXIO, errno.ENODEV, errno.EIO})
_FORBIDDEN = frozenset({errno.EACCES, errno.EPERM})
_TAKEN = frozenset({errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK})
_OTHER_FILE = frozenset({errno.ENOTTY, errno.EISDIR, errno.EINVAL})


_SAID = re.compile(rb"[ -~]{3,60}")


class HungUpError(ConnectionError):
    """A server closed the connection before the first request. said: bytes that it sent before."""

    def __init__(self, said: bytes) -> None:
        words = _SAID.search(said)
        self.words = words[0].decode().strip() if words else ""
        super().__init__(self.words)


def cannot_open(url: str, error: BaseException) -> PortError:
    """Return the error for a port that cannot be opened."""
    if "://" in url:
        return PortError(_network_reason(url, error))
    return PortError(_local_reason(url, error))


def error_number(error: BaseException | None) -> int | None:
    """Return the errno of an exception or of its cause; None if there is none."""
    while error is not None:
        number = getattr(error, "errno", None)
        if isinstance(number, int):
            return number
        # termios.error is not an OSError and has the number as its first argument.
        if error.args and isinstance(error.args[0], int):
            return error.args[0]
        error = error.__cause__ or error.__context__
    return None


def _local_reason(name: str, error: BaseException) -> str:
    number, text = error_number(error), str(error)
    # On Windows pyserial keeps only the text of the system error.
    if number in _ABSENT or "FileNotFoundError" in text:
        return f"port {name} does not exist; {_present()}"
    if number in _TAKEN or "PermissionError" in text:
        return f"port {name} is in use by {_holder(name) or 'another program'}; stop that program first"
    if number in _FORBIDDEN:
        return f"port {name} may not be opened by this user; {_membership(name)}"
    if number in _EMPTY:
        return f"port {name} has no hardware; plug the adapter in, or use another port"
    if number in _OTHER_FILE:
        return f"{name} is not a serial port; {_present()}"
    return f"port {name} cannot be opened ({text}); check its name and its driver"


def _somebody_else(url: str) -> str:
    return _holder(url) or "another client"


def _holder(url: str) -> str:
    # This searches all processes of the machine, so it is only done after a failure.
    from drivecomm.transport.holders import holder_of_port

    holder = holder_of_port(url)
    return "" if holder is None else str(holder)


def _present() -> str:
    from serial.tools import list_ports

    try:
        names = sorted(port.device for port in list_ports.comports())
    except OSError:
        names = []
    if not names:
        return "this machine shows no serial port, so plug the adapter in or check its driver"
    return f"this machine has {', '.join(names)}"


def _membership(name: str) -> str:
    try:
        import grp

        found = os.stat(name)  # noqa: PTH116 - may be a name that Path would change
        group = grp.getgrgid(found.st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return "ask an administrator for access to it"
    if not found.st_mode & stat.S_IRGRP or group == "root":
        return f"it belongs to the group {group}, so ask an administrator for access to it"
    return f"it belongs to the group {group}, so join it (sudo usermod -a -G {group} $USER) and log in again"


def _network_reason(url: str, error: BaseException) -> str:
    scheme = url.split("://", 1)[0].lower()
    if isinstance(error, ValueError) and "not known" in str(error):
        return (
            f"port {url} has the unknown scheme {scheme}://; "
            "use a port's name, socket://HOST:PORT, rfc2217://HOST:PORT, modbus-tcp://HOST or loop://"
        )
    if scheme not in ("socket", "rfc2217", *ONE_PROTOCOL):
        return f"port {url} cannot be opened ({error}); check its name"
    if not _has_host_and_port(url):
        return f"port {url} lacks a host or a port number; write {scheme}://HOST:PORT"
    cause = _deepest(error)
    host = urlsplit(url).hostname
    if isinstance(cause, socket.gaierror):
        return (
            f"port {url} cannot be reached: the host name {host} is not known; check its spelling, or use the address"
        )
    if isinstance(cause, ConnectionRefusedError):
        return f"port {url} cannot be reached: nothing listens there; check the port number and that the server runs"
    if isinstance(cause, TimeoutError):
        return f"port {url} cannot be reached: {host} does not answer; check the address, the network and its firewall"
    if "support RFC2217" in str(error):
        return (
            f"port {url} accepted the connection but negotiates nothing: either it does not speak RFC 2217, so use "
            f"socket://, or switch RFC 2217 on at the server; or it serves {_somebody_else(url)} at present"
        )
    if isinstance(cause, ConnectionError):
        words = f' and said "{cause.words}"' if isinstance(cause, HungUpError) and cause.words else ""
        return (
            f"port {url} is in use by {_holder(url) or 'another program or machine'}: the server closed the connection "
            f"at once{words}; stop that program first"
        )
    return f"port {url} cannot be reached ({cause}); check the address and the network"


def _has_host_and_port(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return bool(parts.hostname and (parts.port or parts.scheme in ONE_PROTOCOL))
    except ValueError:
        return False


def _deepest(error: BaseException) -> BaseException:
    while (below := error.__cause__ or error.__context__) is not None:
        error = below
    return error
