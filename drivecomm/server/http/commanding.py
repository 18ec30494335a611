"""What the API has done: commands, stops, leases, and what is asked of whole lines."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from starlette.exceptions import HTTPException
from starlette.responses import Response, StreamingResponse

from drivecomm.client import error_content, json_text, plain
from drivecomm.errors import DriveCommError, LeaseError, NotAllowedError, TooOftenError, UsageError
from drivecomm.server import Command
from drivecomm.server.http.content import answer_content, lease_content
from drivecomm.server.http.reading import drive_of, json_answer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Mapping

    from drivecomm.server import Answer, Examination, Lease
    from drivecomm.server.http.asked import Asked

_COMMAND = ("id", "lease", "arm", "options", "issued_s", "valid_s", "session")


async def command(asked: Asked) -> Response:
    """Carry out a verb on a drive of the plant."""
    return await _carried_out(asked, drive_of(asked).name, asked.path["verb"], asked.given.get("arguments", {}))


async def command_elsewhere(asked: Asked) -> Response:
    """Carry out a verb on a drive that the plant does not have."""
    _check_line(asked)
    given = asked.given.get("arguments", {})
    return await _carried_out(asked, asked.path["drive"], asked.path["verb"], given, line=asked.path["line"])


async def keep(asked: Asked) -> Response:
    """Start a motor, and keep it while the lease is renewed."""
    arguments = {name: value for name, value in asked.given.items() if name not in _COMMAND}
    return await _carried_out(asked, drive_of(asked).name, "keep", arguments)


async def _carried_out(asked: Asked, drive: str, verb: str, arguments: Mapping[str, Any], line: str = "") -> Response:
    told = {name: asked.given[name] for name in _COMMAND if name in asked.given}
    wanted = Command(drive=drive, verb=verb, line=line, arguments=arguments, **told)
    doing = asked.plant.command(asked.caller, wanted)
    answer = await (_unless_gone(asked, doing) if verb == "wait" else doing)
    if isinstance(answer.error, TooOftenError):
        # As clients that know HTTP, and nothing of drives, understand it.
        raise answer.error
    return json_answer(answer_content(answer))


async def _unless_gone(asked: Asked, doing: Awaitable[Answer]) -> Answer:
    """Wait for what only waits; not for a client that has gone."""
    waiting = asyncio.ensure_future(doing)
    gone = asyncio.ensure_future(_gone(asked))
    try:
        await asyncio.wait({waiting, gone}, return_when=asyncio.FIRST_COMPLETED)
        if not waiting.done():
            raise HTTPException(408, "the client has gone")
        return waiting.result()
    finally:
        waiting.cancel()
        gone.cancel()


async def _gone(asked: Asked) -> None:
    while (await asked.request.receive())["type"] != "http.disconnect":
        pass


async def stop(asked: Asked) -> Response:
    """Stop all drives, or those of some lines."""
    how = asked.given.get("how", "ramp")
    stopped = await asked.plant.stop_all(asked.caller, how, asked.given.get("lines", ()))
    told = [
        {"line": each.line, "drive": each.drive, **answer_content(each.answer), "how": each.how.value}
        for each in stopped
    ]
    return json_answer(told)


async def take_lease(asked: Asked) -> Response:
    """Take the right to command a drive."""
    return _with_key(asked, await asked.plant.take_lease(asked.caller, drive_of(asked).name, asked.given["seconds"]))


async def renew_lease(asked: Asked) -> Response:
    """Have it for longer."""
    given = asked.given
    lease = await asked.plant.renew_lease(asked.caller, drive_of(asked).name, given["key"], given["seconds"])
    return _with_key(asked, lease)


async def end_lease(asked: Asked) -> Response:
    """Give it back."""
    await asked.plant.end_lease(asked.caller, drive_of(asked).name, asked.given["key"])
    return json_answer({"drive": asked.path["name"]})


def _with_key(asked: Asked, lease: Lease) -> Response:
    return json_answer({**lease_content(lease, asked.caller), "key": lease.key})


async def acknowledge(asked: Asked) -> Response:
    """Acknowledge an alarm."""
    return json_answer(await asked.plant.acknowledge(asked.caller, asked.path["id"]))


async def login(asked: Asked) -> Response:
    """Give a token for a password."""
    users, rate, given = asked.plant.users, asked.door.logins, asked.given
    client = asked.request.client
    address = client.host if client else ""
    if users is None:
        raise HTTPException(404, 'this server has no users; write [server] users = "users.toml" in its plant file')
    # One at a time, so that many at once are no more guesses than one after the other.
    async with rate.turn:
        rate.check(address)
        try:
            logged_in = await users.log_in(given["name"], given["password"])
        except NotAllowedError as error:
            rate.failed(address)
            raise HTTPException(401, str(error)) from None
    return json_answer({"token": logged_in.token, "until_s": logged_in.until_s})


async def kept_events(asked: Asked) -> Response:
    """Tell what happens to a motor that is kept running."""
    return await _lines(asked.plant.kept_events(asked.caller, drive_of(asked).name))


async def scan(asked: Asked) -> Response:
    """Look for drives on a line."""
    return await _examined(asked, "scan")


async def doctor(asked: Asked) -> Response:
    """Examine a line."""
    return await _examined(asked, "doctor")


async def trace(asked: Asked) -> Response:
    """Tell each telegram of a line."""
    return await _examined(asked, "trace")


async def statistics(asked: Asked) -> Response:
    """Tell what was counted on a line."""
    return await _examined(asked, "statistics")


async def _examined(asked: Asked, what: Examination) -> Response:
    _check_line(asked)
    return await _lines(asked.plant.examine(asked.caller, asked.path["line"], what, asked.given))


def _check_line(asked: Asked) -> None:
    try:
        asked.plant.plant.line(asked.path["line"])
    except UsageError as error:
        raise HTTPException(404, str(error)) from None


async def _lines(items: AsyncIterator[Mapping[str, Any]]) -> Response:
    """Return an answer of one JSON object a line, as they come; what cannot begin is an error."""

    async def told() -> AsyncIterator[str]:
        try:
            async for item in items:
                yield json_text(plain(item)) + "\n"
        except DriveCommError as error:
            yield json_text({"error": error_content(error)}) + "\n"

    return StreamingResponse(told(), media_type="application/x-ndjson")


def status_of(error: DriveCommError) -> int:
    """Return the HTTP status of an error that is none of a command."""
    if isinstance(error, TooOftenError):
        return 429
    if isinstance(error, NotAllowedError):
        return 403
    if isinstance(error, LeaseError):
        return 409
    return 422 if isinstance(error, UsageError) else 503
