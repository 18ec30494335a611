"""Where servers are found: each has a record in a runtime folder, which it holds locked for as long as it lives.

    with register(Registration(plant="/etc/drivecomm/hall.toml", ...)) as record:
        ...

A record whose process has gone, or that nobody holds locked, is of a server that was killed, and counts for nothing.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.client.runtime_folders import folder_of_servers, folders_to_search, is_private
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_RECORD = ".server.json"
_SOCKET = ".sock"
_LONGEST_RECORD = 1 << 20
_LONGEST_SOCKET = 100
# Whoever only looks holds the lock for an instant.
_LOCK_S = 1.0
_TRY_AGAIN_S = 0.01
_READS = 3
_LOCKED_BYTE = 1 << 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration:
    """A server that runs.

    plant: the real path of its plant file. name: what it calls the plant. socket: its local socket; where there are no
    Unix sockets it is empty, and port and token lead to it. lines: the port of each line, by its name. started_s: in
    seconds since 1970. history: the file of its history, None where it keeps none. version: of drivecomm.
    """

    plant: str
    pid: int = field(default_factory=os.getpid)
    name: str = ""
    socket: str = ""
    port: int = 0
    token: str = field(default="", repr=False)
    lines: Mapping[str, str] = field(default_factory=dict, hash=False)
    started_s: float = 0.0
    history: str | None = None
    version: str = ""

    def __str__(self) -> str:
        return f"drivecomm serve {self.plant} (pid {self.pid})"


def identity(plant: str | Path) -> str:
    """Return what files that belong to a plant are named after: its stem, and its real path in short."""
    from hashlib import sha256  # noqa: PLC0415 - takes long to load, and only plants need it

    real = os.path.realpath(plant)
    return f"{Path(real).stem}-{sha256(os.fsencode(real)).hexdigest()[:8]}"


def local_socket(plant: str | Path) -> Path:
    """Return the socket on which the server of a plant is reached; its folder is this user's alone.

    Clients find it by the server's record. Raises PermissionError for a folder that belongs to somebody else.
    """
    usual = folder_of_servers() / f"{identity(plant)}{_SOCKET}"
    if len(os.fsencode(usual)) <= _LONGEST_SOCKET:
        return usual
    # The system has no room for a longer path of a socket.
    from tempfile import gettempdir  # noqa: PLC0415 - seldom needed

    short = Path(gettempdir()) / f"drivecomm-{os.getuid()}" / f"{identity(plant)[-8:]}{_SOCKET}"
    _make_private(short.parent)
    return short


@contextmanager
def register(server: Registration) -> Iterator[Path]:
    """Let others find this server for the time of the block; yield its record, which may be written again meanwhile.

    Raises UsageError where a server of this plant runs already, OSError where no record can be written.
    """
    record = folder_of_servers() / f"{identity(server.plant)}{_RECORD}"
    _make_private(record.parent)
    if (other := server_of_plant(server.plant)) is not None:
        raise _runs_already(other)
    descriptor = _locked(record)
    if descriptor is None:
        raise _runs_already(server_of_plant(server.plant))
    try:
        os.ftruncate(descriptor, 0)
        os.write(descriptor, json.dumps(asdict(server)).encode())
        yield record
    finally:
        # While it is still locked, so that nobody else's record is removed; Windows removes no file that is open.
        with suppress(OSError):
            record.unlink()
        os.close(descriptor)
        if os.name != "posix":
            with suppress(OSError):
                record.unlink()


def server_of_plant(plant: str | Path) -> Registration | None:
    """Return the server of a plant file, by whatever name or link the file is called; None where none runs."""
    name = f"{identity(plant)}{_RECORD}"
    for folder in folders_to_search():
        if (found := _running(folder / name)) is not None:
            return found
    return None


def server_of_port(port: str) -> tuple[Registration, str] | None:
    """Return the server that has a port, and what it calls the line there; None where none has it."""
    for server in servers():
        for line, its_port in server.lines.items():
            # Only where there is a server anything of a port's name matters.
            from drivecomm.transport import same_port  # noqa: PLC0415

            if same_port(its_port, port):
                return server, line
    return None


def servers() -> Iterator[Registration]:
    """Yield the servers of this machine that this user may see."""
    for folder in folders_to_search():
        try:
            names = sorted(name for name in os.listdir(folder) if name.endswith(_RECORD))  # noqa: PTH208 - one call
        except OSError:
            continue
        for name in names:
            if (found := _running(folder / name)) is not None:
                yield found


def _make_private(folder: Path) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (os.environ.get("RUNTIME_DIRECTORY") or is_private(folder)):
        raise PermissionError(f"{folder} belongs to another user, or others can write to it")


def _running(record: Path) -> Registration | None:
    """Return the server that holds this record locked."""
    try:
        descriptor = os.open(record, os.O_RDONLY)
    except OSError:
        return None
    try:
        for _ in range(_READS):
            if not _is_held(descriptor):
                return None
            try:
                found = _read(descriptor)
            except (ValueError, TypeError, AttributeError):
                # It is just being written.
                time.sleep(_TRY_AGAIN_S)
            else:
                return found if _is_alive(found.pid) else None
        return None
    finally:
        os.close(descriptor)


def _read(descriptor: int) -> Registration:
    os.lseek(descriptor, 0, os.SEEK_SET)
    content: dict[str, Any] = json.loads(os.read(descriptor, _LONGEST_RECORD))
    known = {each.name for each in fields(Registration)}
    found = Registration(**{name: value for name, value in content.items() if name in known})
    if not (isinstance(content.get("pid"), int) and isinstance(found.plant, str) and isinstance(found.lines, dict)):
        raise TypeError("not a record")
    return found


def _is_held(descriptor: int) -> bool:
    try:
        import fcntl  # noqa: PLC0415 - Windows has none
    except ImportError:
        return not _locks_a_byte(descriptor, for_good=False)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        # There, signal 0 would end the process instead of looking for it.
        return pid > 0
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        # Another user's.
        return True
    return True


def _locked(record: Path) -> int | None:
    """Open a record and lock it; None where another server has it."""
    until = time.monotonic() + _LOCK_S
    while True:
        descriptor = os.open(record, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            if _take(descriptor) and _is_still(record, descriptor):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        if time.monotonic() >= until:
            return None
        time.sleep(_TRY_AGAIN_S)


def _take(descriptor: int) -> bool:
    try:
        import fcntl  # noqa: PLC0415 - as above
    except ImportError:
        return _locks_a_byte(descriptor, for_good=True)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _locks_a_byte(descriptor: int, *, for_good: bool) -> bool:
    """Lock a record as Windows can: a byte far behind its content, which everybody may read then as before."""
    windows: Any = import_module("msvcrt")
    os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
    try:
        windows.locking(descriptor, windows.LK_NBLCK, 1)
        if not for_good:
            windows.locking(descriptor, windows.LK_UNLCK, 1)
    except OSError:
        return False
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)
    return True


def _is_still(record: Path, descriptor: int) -> bool:
    """Whether the file that was locked is the one of this name: a server that ends removes its own."""
    try:
        return os.path.samestat(os.stat(record), os.fstat(descriptor))  # noqa: PTH116
    except OSError:
        return False


def _runs_already(other: Registration | None) -> UsageError:
    if other is None:
        return UsageError("another server of this plant begins or ends just now; try again")
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(other.started_s))
    return UsageError(
        f"{other.plant} has a server already (pid {other.pid}, since {since}); use that one, or end it first"
    )


def written_again(record: Path, server: Registration) -> None:
    """Write a record anew while it is held, such as after the plant file was read again."""
    with record.open("r+b") as file:
        file.write(json.dumps(asdict(server)).encode())
        file.truncate()
