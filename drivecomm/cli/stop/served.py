"""Stopping through the server that owns the lines.

A server that does not answer soon is left alone, and the ports are tried as if there were none: a motor is stopped by
whatever way is left.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drivecomm.cli.output import complain
from drivecomm.client import server_of_plant, server_of_port
from drivecomm.errors import LinkError, ServerLostError, UsageError
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.cli.control.client import StopResult
    from drivecomm.client import Registration
    from drivecomm.protocol import DriveConfig

_ALIVE_S = 1.0
# A stop with all the attempts that silent drives may have.
_LONGEST_S = 20.0


def all_stopped_by_server(plant: Path | None, port: str | None, how: Stop, *, as_json: bool) -> list[StopResult]:
    """Have the server of a plant stop all its drives, or that of a port those on its line; return what came of it.

    Nothing where there is no server, or none that answers.
    """
    server = None if plant is None else server_of_plant(plant)
    lines: list[str] = []
    if server is None and port and (place := server_of_port(port)) is not None:
        server, lines = place[0], [place[1]]
    if server is None:
        return []
    asked = {"how": how.value, **({"lines": lines} if lines else {})}
    try:
        answers = _ordered(server, "/api/v1/stop", asked)
    except LinkError as error:
        complain(f"{error}; the ports themselves are tried now", as_json=as_json)
        return []
    return [_result(each) for each in answers]


def one_stopped_by_server(port: str, drive: DriveConfig, how: Stop, said: dict[str, Any], *, as_json: bool) -> bool:
    """Have the server that has a port stop a drive; False where there is no server, or none that answers.

    said: line facts of the command line, which are left out where they cannot be. Raises the error that the drive
    answered with.
    """
    if (found := server_of_port(port)) is None:
        return False
    server, line = found
    # Loaded by those who have a server only.
    from drivecomm.client import error_of  # noqa: PLC0415
    from drivecomm.plant import drives_of  # noqa: PLC0415

    known = {str(each): each.name for each in drives_of(server, line)}
    path = f"lines/{quote(line, safe='')}/drives/{drive}"
    if str(drive) in known:
        path = f"drives/{quote(known[str(drive)], safe='')}"
    asked = {"id": os.urandom(8).hex(), "arguments": {"how": how.value}}
    try:
        answer = _ordered(server, f"/api/v1/{path}/stop", {**asked, **({"options": said} if said else {})})
        if said and (answer.get("error") or {}).get("exit_code") == UsageError.exit_code:
            answer = _ordered(server, f"/api/v1/{path}/stop", {**asked, "id": os.urandom(8).hex()})
    except ServerLostError as error:
        complain(f"{error}; the port itself is tried now", as_json=as_json)
        return False
    if answer.get("error"):
        raise error_of(answer["error"])
    return True


def _ordered(server: Registration, path: str, content: dict[str, Any]) -> Any:
    # HTTP takes long to load, and is for those who have a server.
    from drivecomm.client import LocalServer  # noqa: PLC0415

    return LocalServer(server, alive_s=_ALIVE_S).order(path, content, limit_s=_LONGEST_S)


def _result(answer: dict[str, Any]) -> StopResult:
    from drivecomm.cli.control.client import StopResult  # noqa: PLC0415 - as above
    from drivecomm.client import error_of  # noqa: PLC0415 - as above

    error = error_of(answer["error"]) if answer.get("error") else None
    name, line = str(answer["drive"]), str(answer["line"])
    if name.endswith(":*"):
        return StopResult(line=line, protocol=name.removesuffix(":*"), how=Stop(answer["how"]), error=error)
    return StopResult(line=line, drive=name, how=Stop(answer["how"]), error=error)
