"""The client of a control server: has the `start` that holds a port stop drives on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.cli.control.sockets import connect, socket_file
from drivecomm.errors import DriveCommError, DriveError, LinkError, PortError, ReplyError, UsageError
from drivecomm.protocol import LINE_FACT_NAMES, Stop, commanded_by_model, one_stop_fits_all

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from drivecomm.cli.control.sockets import Connection

_GREETING_S = 1.0
# Longer than the holder of the port takes to end.
_ANSWER_S = 20.0
_ERRORS: tuple[type[DriveCommError], ...] = (UsageError, LinkError, ReplyError, DriveError)


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRequest:
    """Drives by name, protocol, address and options; protocols for a broadcast; everything: also the holder's drive."""

    how: Stop
    drives: tuple[tuple[str, str, int, Mapping[str, Any]], ...] = ()
    protocols: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    everything: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """What became of a stop: of a drive by its name, or where that is empty of a broadcast.

    how: other than asked for where that is not possible. error: why a drive has not confirmed, or a broadcast was not
    sent. line: its name in the plant. without: what was left out, because it was invalid.
    """

    line: str = ""
    drive: str = ""
    protocol: str = ""
    how: Stop
    error: Exception | None = None
    without: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Holder:
    """The program that holds the port. ended: it has stopped its own drive and ended."""

    name: str
    ended: bool

    def __str__(self) -> str:
        return f"{self.name}, which has ended, its watchdog as it was" if self.ended else self.name


def stop_by_holder(
    port: str | None,
    request: StopRequest,
    tell: Callable[[StopResult], None],
    opening: Mapping[str, Any] | None = None,
) -> Holder | None:
    """Have drives stopped by the `start` that holds this port; None, and nothing done, when there is none.

    opening: the keywords of `open_bus` that they would be stopped with otherwise. Raises PortError when it does not
    answer.
    """
    if not port:
        return None
    try:
        connection = connect(socket_file(port), _GREETING_S)
    except (TimeoutError, BlockingIOError) as error:
        raise _hangs(port, None, error) from error
    except (OSError, ValueError):
        # Whatever is wrong with the control socket does not prevent opening the port.
        return None
    if connection is None:
        return None
    try:
        return _asked(connection, request, tell, opening or {})
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
    connection: Connection, request: StopRequest, tell: Callable[[StopResult], None], opening: Mapping[str, Any]
) -> Holder:
    greeting = connection.read(_GREETING_S)
    name = f"drivecomm start {greeting['drive']} (pid {greeting['pid']})"
    facts = {key: value for key, value in opening.items() if key in LINE_FACT_NAMES and value is not None}
    connection.write(
        order="stop",
        how=request.how.value,
        drives=[[who, protocol, at, {**facts, **_plain(options)}] for who, protocol, at, options in request.drives],
        protocols=[[protocol, {**facts, **_plain(options)}] for protocol, options in request.protocols],
        everything=request.everything,
    )
    while True:
        answer = connection.read(_ANSWER_S)
        if answer.get("over"):
            if answer.get("error"):
                raise ValueError(answer["error"])
            return Holder(name=name, ended=bool(answer["ended"]))
        tell(
            StopResult(
                drive=str(answer.get("drive", "")),
                protocol=str(answer.get("protocol", "")),
                how=Stop(answer["how"]),
                error=_error(str(answer["error"]), answer["exit_code"]),
            )
        )


def _plain(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as they can be written down; a model's file is found from anywhere."""
    model = options.get("model")
    if model is None:
        return dict(options)
    return {**options, "model": str(Path(model).resolve()) if str(model).endswith(".toml") else str(model)}


def _error(text: str, exit_code: object) -> DriveCommError | None:
    if not text:
        return None
    kind = next((kind for kind in _ERRORS if kind.exit_code == exit_code), DriveCommError)
    return kind(text)


def _is_commanded_by_model(protocol: str) -> bool:
    try:
        return commanded_by_model(protocol)
    except UsageError:
        # Whoever stops its drives is told that there is no such protocol.
        return False


def broadcasts(drives: Iterable[tuple[str, str, int, Mapping[str, Any]]]) -> tuple[tuple[str, Mapping[str, Any]], ...]:
    """Return the broadcasts that reach these drives: one for each protocol and each of the options that they have.

    There is none where what stops one of them could start another.
    """
    known = list(drives)
    found: list[tuple[str, Mapping[str, Any]]] = []
    for _, protocol, _, options in known:
        with_model = _is_commanded_by_model(protocol)
        one = (protocol, {key: value for key, value in options.items() if with_model or key != "model"})
        alike = (each for _, other, _, each in known if other == protocol)
        if one not in found and (not with_model or one_stop_fits_all(protocol, alike)):
            found.append(one)
    return tuple(found)
