"""Asking the `start` that holds a port to stop drives on it, through its door (`drivecomm.cli.start_door`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.cli.door_places import door_file, reached
from drivecomm.errors import DriveCommError, DriveError, LinkError, PortError, ReplyError, UsageError
from drivecomm.protocol import LINE_FACT_NAMES, Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from drivecomm.cli.door_places import Connection

_GREETING_S = 1.0
# Longer than it takes to end for the one who holds the port.
_ANSWER_S = 20.0
_ERRORS: tuple[type[DriveCommError], ...] = (UsageError, LinkError, ReplyError, DriveError)


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatToStop:
    """Drives by name, protocol, address and options; protocols for a broadcast; everything: also what it keeps."""

    how: Stop
    drives: tuple[tuple[str, str, int, Mapping[str, Any]], ...] = ()
    protocols: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    everything: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What became of one of them. drive: its name, empty for a broadcast."""

    drive: str = ""
    protocol: str = ""
    how: Stop
    error: DriveCommError | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Keeper:
    """The program that did it. ended: it has left its own drive, and its port with it."""

    name: str
    ended: bool

    def __str__(self) -> str:
        return f"{self.name}, which has ended, its watchdog as it was" if self.ended else self.name


def stopped_by_its_keeper(
    port: str | None, what: WhatToStop, tell: Callable[[Answer], None], opening: Mapping[str, Any] | None = None
) -> Keeper | None:
    """Have drives stopped by the `start` that holds this port; None, and nothing done, when there is none.

    opening: the keywords of `open_bus` that they would be stopped with otherwise. Raises PortError when it does not
    answer.
    """
    if not port:
        return None
    connection = None
    try:
        connection = reached(door_file(port), _GREETING_S)
    except (TimeoutError, BlockingIOError) as error:
        raise _hangs(port, None, error) from error
    except (OSError, ValueError):
        # Whatever is wrong with the door keeps nobody from opening the port.
        pass
    if connection is None:
        return None
    try:
        return _asked(connection, what, tell, opening or {})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _hangs(port, connection.pid, error) from error
    finally:
        connection.close()


def _hangs(port: str, pid: int | None, error: Exception) -> PortError:
    which = f" (pid {pid})" if pid else ""
    return PortError(
        f"port {port} is held by drivecomm start{which}, which does not answer ({error}); end it, and its drive's "
        "watchdog stops the motor"
    )


def _asked(
    connection: Connection, what: WhatToStop, tell: Callable[[Answer], None], opening: Mapping[str, Any]
) -> Keeper:
    greeting = connection.read(_GREETING_S)
    name = f"drivecomm start {greeting['drive']} (pid {greeting['pid']})"
    facts = {key: value for key, value in opening.items() if key in LINE_FACT_NAMES and value is not None}
    connection.write(
        order="stop",
        how=what.how.value,
        drives=[[who, protocol, at, {**facts, **_plain(options)}] for who, protocol, at, options in what.drives],
        protocols=[[protocol, {**facts, **_plain(options)}] for protocol, options in what.protocols],
        everything=what.everything,
    )
    while True:
        answer = connection.read(_ANSWER_S)
        if answer.get("over"):
            if answer.get("error"):
                raise ValueError(answer["error"])
            return Keeper(name=name, ended=bool(answer["ended"]))
        told = Answer(
            drive=str(answer.get("drive", "")),
            protocol=str(answer.get("protocol", "")),
            how=Stop(answer["how"]),
            error=_error(str(answer["error"]), answer["exit_code"]),
        )
        tell(told)


def _plain(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as they can be written down; a model's file is found from anywhere."""
    from pathlib import Path  # noqa: PLC0415 - only who has found a door

    model = options.get("model")
    if model is None:
        return dict(options)
    return {**options, "model": str(Path(model).resolve()) if str(model).endswith(".toml") else str(model)}


def _error(text: str, exit_code: object) -> DriveCommError | None:
    if not text:
        return None
    kind = next((kind for kind in _ERRORS if kind.exit_code == exit_code), DriveCommError)
    return kind(text)


def broadcasts(drives: Iterable[tuple[str, str, int, Mapping[str, Any]]]) -> tuple[tuple[str, Mapping[str, Any]], ...]:
    """Return the broadcasts that reach these drives: one for each protocol and each of the options that they have."""
    found: list[tuple[str, Mapping[str, Any]]] = []
    for _, protocol, _, options in drives:
        one = (protocol, {key: value for key, value in options.items() if key not in ("model", "read_only")})
        if one not in found:
            found.append(one)
    return tuple(found)
