"""The programs that hold ports, as far as the system reveals them: on Linux from /proc, on other systems never.

Processes of other users are visible only to an administrator; locks are visible to all.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_PROC = Path("/proc")
_ESTABLISHED = "01"
_MASTER_ENDS = ("/dev/ptmx", "/dev/pts/ptmx")


@dataclass(frozen=True, slots=True, kw_only=True)
class Holder:
    """Another process. name: its program, with the subcommand for drivecomm."""

    name: str
    pid: int

    def __str__(self) -> str:
        return f"{self.name} (pid {self.pid})"


def holder_of_port(url: str) -> Holder | None:
    """Return the local process that holds a port or is connected to this server; None if unknown."""
    with suppress(OSError, ValueError):
        if "://" in url:
            return _connected(url)
        return _locking(url) or _having_open(url)
    return None


def server_of_terminal(name: str) -> Holder | None:
    """Return the process at the other end of a pseudo-terminal; None if unknown."""
    with suppress(OSError):
        pid = next(_having(_is_master_of(os.path.realpath(name))), None)
        return None if pid is None else _named(pid)
    return None


def _locking(name: str) -> Holder | None:
    """Return the process that has locked the file with flock."""
    found = Path(name).stat()
    locked = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
    for line in (_PROC / "locks").read_text().splitlines():
        # "1: FLOCK  ADVISORY  WRITE 708 00:15:9 0 EOF"; entries waiting for a lock have "->" after the number.
        words = line.split()
        if words[1] == "FLOCK" and words[5] == locked and int(words[4]) not in (0, os.getpid()):
            return _named(int(words[4]))
    return None


def _having_open(name: str) -> Holder | None:
    """Return a process that has opened the port, but not the one that serves the pseudo-terminal."""
    path = os.path.realpath(name)
    serves = _is_master_of(path)
    for pid in _having(lambda link: _target(link) == path):
        if not any(map(serves, _links_of(pid))):
            return _named(pid)
    return None


def _connected(url: str) -> Holder | None:
    parts = urlsplit(url)
    if not parts.hostname or not parts.port:
        return None
    found = socket.getaddrinfo(parts.hostname, parts.port, type=socket.SOCK_STREAM)
    ends = {(socket.inet_pton(family, str(address[0])), parts.port) for family, _, _, _, address in found}
    sockets = {f"socket:[{inode}]" for table in ("tcp", "tcp6") for end, inode in _connections(table) if end in ends}
    pid = next(_having(lambda link: _target(link) in sockets), None) if sockets else None
    return None if pid is None else _named(pid)


def _connections(table: str) -> Iterator[tuple[tuple[bytes, int], str]]:
    """Yield remote end and inode of each connection (Linux, Documentation/networking/proc_net_tcp.rst)."""
    with suppress(FileNotFoundError):
        for line in (_PROC / "net" / table).read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == _ESTABLISHED:
                address, _, port = words[2].partition(":")
                raw = bytes.fromhex(address)
                # Each four-byte word is in the byte order of this machine.
                host = b"".join(raw[at : at + 4][::-1] for at in range(0, len(raw), 4))
                mapped = host.removeprefix(bytes(10) + b"\xff\xff") if len(host) == 16 else host
                yield (mapped, int(port, 16)), words[9]


def _having(is_meant: Callable[[Path], bool]) -> Iterator[int]:
    """Yield the other processes with a matching open file, if this user may inspect them."""
    own = os.getpid()
    for pid in (int(each.name) for each in _PROC.iterdir() if each.name.isdigit()):
        if pid != own and any(map(is_meant, _links_of(pid))):
            yield pid


def _links_of(pid: int) -> list[Path]:
    with suppress(OSError):
        return list((_PROC / str(pid) / "fd").iterdir())
    return []


def _target(link: Path) -> str:
    with suppress(OSError):
        return str(link.readlink())
    return ""


def _is_master_of(path: str) -> Callable[[Path], bool]:
    number = path.removeprefix("/dev/pts/")

    def is_it(link: Path) -> bool:
        if not number.isdigit() or _target(link) not in _MASTER_ENDS:
            return False
        with suppress(OSError):
            return f"tty-index:\t{number}\n" in (link.parent.parent / "fdinfo" / link.name).read_text()
        return False

    return is_it


def _named(pid: int) -> Holder | None:
    """Return a process with the name of its program; None if it has ended."""
    try:
        words = (_PROC / str(pid) / "cmdline").read_bytes().decode(errors="replace").rstrip("\0").split("\0")
        name = (_PROC / str(pid) / "comm").read_text().strip()
    except OSError:
        return None
    program = Path(words[0]).name
    if program.startswith("python") and len(words) > 1:
        rest = words[words.index("-m") + 1 :] if words[1] == "-m" else words[1:]
        program = Path(rest[0]).name if rest and not rest[0].startswith("-") else program
        words = rest or words
    if program == "drivecomm" and len(words) > 1:
        return Holder(name=f"drivecomm {words[1]}", pid=pid)
    return Holder(name=program or name, pid=pid)
