"""Registration of programs that have a line: each has a record in a runtime folder, locked while it lives.

    with register(Registration(plant="/etc/drivecomm/hall.toml", ...)) as record:
        ...

Servers accept every request; any other program with a port, such as `poll`, accepts only stops.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.client.locked_records import lock_record, read_locked_record
from drivecomm.client.runtime_folders import folder_of_servers, folders_to_search, make_private, users_folder
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from drivecomm.client.locked_records import HeldRecord

_RECORD = ".server.json"
_HOLDERS_RECORD = ".holder.json"
_SOCKET = ".sock"
_LONGEST_SOCKET = 100
_ONE_AT_A_TIME = "registering.lock"


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration:
    """Running program that has lines.

    plant: real path of a server's plant file, empty for any other program. name: name of the plant. socket: local
    socket of the program; empty on systems without Unix sockets, which use port and token instead. lines: port of each
    line, by its name. started_s: seconds since 1970. history: file of its history, None without one. version: version
    of drivecomm. program: name for display.
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
    program: str = "drivecomm serve"

    def __str__(self) -> str:
        return f"{f'{self.program} {self.plant}'.rstrip()} (pid {self.pid})"


def identity(plant: str | Path) -> str:
    """Return the base name of files that belong to a plant: its stem, and a hash of its real path."""
    from hashlib import sha256

    real = os.path.realpath(plant)
    return f"{Path(real).stem}-{sha256(os.fsencode(real)).hexdigest()[:8]}"


def local_socket(plant: str | Path) -> Path:
    """Return the path of the local socket of a plant's server; its folder is accessible to this user only.

    Clients find the socket by the server's record. Raises PermissionError for a folder that belongs to another user.
    """
    return _short_enough(folder_of_servers() / f"{identity(plant)}{_SOCKET}", identity(plant)[-8:])


def _short_enough(usual: Path, short: str) -> Path:
    """Return a socket path within the short limit of the system."""
    if len(os.fsencode(usual)) <= _LONGEST_SOCKET:
        return usual
    from tempfile import gettempdir

    folder = Path(os.path.realpath(gettempdir())) / f"drivecomm-{os.getuid()}"
    make_private(folder)
    return folder / f"{short}{_SOCKET}"


@contextmanager
def register(server: Registration) -> Iterator[Path]:
    """Publish the record of this server during the block; yield its path, for `rewrite_record`.

    Raises UsageError if a server of this plant, or of one of its ports, is already running. Raises UsageError if the
    record cannot be written: commands would then not find the server and would open its ports themselves. Raises
    OSError for a folder that cannot be created, or that other users can write to.
    """
    record = folder_of_servers() / f"{identity(server.plant)}{_RECORD}"
    make_private(record.parent)
    try:
        held = _registered(server, record)
    except OSError as error:
        raise UsageError(
            f"{server.plant} cannot be served: commands would not find the server, because its record cannot be "
            f"written to {record.parent} ({error.strerror or error}); make room there, or set XDG_RUNTIME_DIR"
        ) from error
    try:
        yield held.path
    finally:
        held.release()


def _registered(server: Registration, record: Path) -> HeldRecord:
    # The lock ensures that of two servers that start together, one sees the other.
    turn = lock_record(record.parent / _ONE_AT_A_TIME)
    try:
        if (other := server_of_plant(server.plant)) is not None:
            raise _runs_already(other)
        check_ports(server)
        held = lock_record(record)
        if held is None:
            raise _runs_already(server_of_plant(server.plant))
        try:
            held.write(asdict(server))
        except BaseException:
            held.release()
            raise
        return held
    finally:
        if turn is not None:
            turn.release()


def check_ports(server: Registration) -> None:
    """Raise UsageError if a server of another plant has one of these ports, since a line has one owner."""
    for line, port in server.lines.items():
        for other, _ in servers_of_port(port):
            if other.plant != server.plant:
                raise UsageError(
                    f"{server.plant}: line {line} is at {port}, which {other} has; use that server, end it, or take "
                    "the line out of one of the two plant files"
                )


def rewrite_record(record: Path, server: Registration) -> None:
    """Rewrite a record while it is held, such as after a reload of the plant file."""
    with record.open("r+b") as file:
        file.write(json.dumps(asdict(server)).encode())
        file.truncate()


@contextmanager
def register_holder(holder: Registration, socket: Path) -> Iterator[None]:
    """Publish a program that has a port during the block, so that stops find it. Raises OSError."""
    held = lock_record(users_folder() / f"{socket.stem}{_HOLDERS_RECORD}")
    if held is None:
        raise FileExistsError(f"{socket} belongs to another program")
    try:
        held.write(asdict(holder))
        yield
    finally:
        held.release()


def holders_socket(number: int) -> Path:
    """Return the socket path for one of this process's ports. Raises OSError if there is no place for sockets."""
    folder = users_folder()
    make_private(folder)
    _clear_up(folder)
    name = f"{os.getpid()}-{number}"
    return _short_enough(folder / f"{name}{_SOCKET}", name)


def server_of_plant(plant: str | Path) -> Registration | None:
    """Return the server of a plant file, under any name or link of the file; None if none is running."""
    name = f"{identity(plant)}{_RECORD}"
    for folder in folders_to_search():
        if (found := _running(folder / name)) is not None:
            return found
    return None


def server_of_port(port: str) -> tuple[Registration, str] | None:
    """Return the server that has a port, and its name of the line; None if no server has it."""
    return next(servers_of_port(port), None)


def servers_of_port(port: str) -> Iterator[tuple[Registration, str]]:
    """Yield each server whose plant has a port, with its name of the line."""
    return _with_port(servers(), port)


def holders_of_port(port: str) -> Iterator[tuple[Registration, str]]:
    """Yield the programs of this user that have a port and are not servers, with their name of the line."""
    found = (_running(record) for record in _records(_HOLDERS_RECORD))
    return _with_port((each for each in found if each is not None), port)


def servers() -> Iterator[Registration]:
    """Yield the servers of this machine that this user may see."""
    for record in _records(_RECORD):
        if (found := _running(record)) is not None:
            yield found


def _with_port(programs: Iterable[Registration], port: str) -> Iterator[tuple[Registration, str]]:
    for each in programs:
        for line, its_port in each.lines.items():
            # Imported late, because port names need comparing only if another program runs.
            from drivecomm.transport import same_port

            if same_port(str(its_port), port):
                yield each, line


def _records(ending: str) -> Iterator[Path]:
    for folder in folders_to_search():
        try:
            names = sorted(name for name in os.listdir(folder) if name.endswith(ending))  # noqa: PTH208 - a single system call
        except OSError:
            continue
        yield from (folder / name for name in names)


def _clear_up(folder: Path) -> None:
    """Remove sockets and records of killed programs."""
    with suppress(OSError):
        for record in list(folder.glob(f"*{_HOLDERS_RECORD}")):
            number = record.name.partition("-")[0]
            if number.isdecimal() and not _is_alive(int(number)):
                record.with_name(record.name.replace(_HOLDERS_RECORD, _SOCKET)).unlink(missing_ok=True)
                record.unlink(missing_ok=True)


def _running(record: Path) -> Registration | None:
    """Return the program that keeps this record locked."""
    content = read_locked_record(record)
    if content is None:
        return None
    known = {each.name for each in fields(Registration)}
    try:
        found = Registration(**{name: value for name, value in content.items() if name in known})
    except TypeError:
        return None
    meant = isinstance(found.pid, int) and isinstance(found.plant, str) and isinstance(found.lines, dict)
    return found if meant and "pid" in content and _is_alive(found.pid) else None


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        # On Windows, signal 0 would end the process instead of testing it.
        return pid > 0
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        # The process belongs to another user.
        return True
    return True


def _runs_already(other: Registration | None) -> UsageError:
    if other is None:
        return UsageError("another server of this plant is starting or stopping; try again")
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(other.started_s))
    return UsageError(
        f"{other.plant} has a server already (pid {other.pid}, since {since}); use that one, or end it first"
    )
