"""Routes that act: commands, stops, leases, and requests about whole lines."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from starlette.exceptions import HTTPException
from starlette.responses import Response

from drivecomm.client import error_content, json_text, plain
from drivecomm.errors import DriveCommError, NotAllowedError, TooOftenError, UsageError
from drivecomm.protocol import Stop
from drivecomm.server import CommandRequest, Role
from drivecomm.server.http import answers, fields
from drivecomm.server.http.content import answer_content, lease_content
from drivecomm.server.http.fields import DriveName, LineName, Verb
from drivecomm.server.http.problems import problem, status_of
from drivecomm.server.http.reading import find_drive
from drivecomm.server.http.route import V1, ApiRequest, Lines, json_answer, route

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Mapping

    from drivecomm.server import CommandAnswer, Examination, Lease

_EVERY_COMMAND = set(fields.Fresh.model_fields)
_DRIVE, _LINE = f"{V1}/drives/{{name}}", f"{V1}/lines/{{line}}"


@route("POST", f"{V1}/alarms/{{id}}/acknowledge", answers.Alarm, named=True)
async def acknowledge(asked: ApiRequest, id: fields.AlarmId) -> Response:
    """Acknowledge an alarm."""
    return json_answer(await asked.plant.acknowledge(asked.caller, id))


@route("POST", f"{V1}/login", answers.Login, role=Role.NOBODY)
async def login(asked: ApiRequest, body: fields.Credentials) -> Response:
    """Exchange a name and a password for a token, which is then sent as Authorization: Bearer TOKEN."""
    users, rate = asked.plant.users, asked.door.logins
    address = asked.client.host if asked.client else ""
    if users is None:
        raise HTTPException(404, 'this server has no users; write [server] users = "users.toml" in its plant file')
    # One login at a time, so that parallel requests allow no more guesses than sequential ones.
    async with rate.turn:
        rate.check(address)
        try:
            logged_in = await users.log_in(body.name, body.password)
        except NotAllowedError as error:
            rate.failed(address)
            raise HTTPException(401, str(error)) from None
    return json_answer({"token": logged_in.token, "until_s": logged_in.until_s})


@route("POST", f"{V1}/stop", answers.Stops, named=True)
async def stop(asked: ApiRequest, body: fields.StopAll) -> Response:
    """Stop all drives of all lines, or of the named lines; needs no lease."""
    stopped = await asked.plant.stop_all(asked.caller, (body.how or Stop.RAMP).value, body.lines or ())
    return json_answer([
        {"line": each.line, "drive": each.drive, **answer_content(each.answer), "how": each.how.value}
        for each in stopped
    ])  # fmt: skip


@route("POST", f"{_DRIVE}/lease", answers.OwnLease, named=True)
async def take_lease(asked: ApiRequest, name: DriveName, body: fields.TakeLease) -> Response:
    """Acquire the lease of a drive, which gives the right to command it."""
    return _with_key(asked, await asked.plant.take_lease(asked.caller, find_drive(asked, name).name, body.seconds))


@route("PUT", f"{_DRIVE}/lease", answers.OwnLease, named=True)
async def renew_lease(asked: ApiRequest, name: DriveName, body: fields.RenewLease) -> Response:
    """Renew a lease."""
    drive = find_drive(asked, name).name
    return _with_key(asked, await asked.plant.renew_lease(asked.caller, drive, body.key, body.seconds))


@route("DELETE", f"{_DRIVE}/lease", answers.EndedLease, named=True)
async def end_lease(asked: ApiRequest, name: DriveName, body: fields.EndLease) -> Response:
    """Release a lease."""
    await asked.plant.end_lease(asked.caller, find_drive(asked, name).name, body.key)
    return json_answer({"drive": name})


def _with_key(asked: ApiRequest, lease: Lease) -> Response:
    return json_answer({**lease_content(lease, asked.caller), "key": lease.key})


@route("GET", f"{_DRIVE}/keep/events", form=Lines)
async def kept_events(asked: ApiRequest, name: DriveName) -> Response:
    """Events of a kept motor, until the server no longer keeps it running."""
    return _lines(asked.plant.kept_events(asked.caller, find_drive(asked, name).name))


@route("POST", f"{_DRIVE}/keep", answers.Answer, named=True)
async def keep(asked: ApiRequest, name: DriveName, body: fields.Keep) -> Response:
    """Set a drive's watchdog, start its motor, and keep it while the lease is renewed."""
    given = body.model_dump(include=body.model_fields_set - _EVERY_COMMAND)
    return await _carried_out(asked, body, given, drive=find_drive(asked, name).name, verb="keep")


@route("POST", f"{_DRIVE}/stop", answers.Answer, named=True)
async def stop_drive(asked: ApiRequest, name: DriveName, body: fields.StopDrive) -> Response:
    """Stop a drive. Every request sends a stop, also a repeated one."""
    return await _carried_out(asked, body, body.arguments or {}, drive=find_drive(asked, name).name, verb="stop")


@route("POST", f"{_DRIVE}/{{verb}}", answers.Answer, named=True)
async def command(asked: ApiRequest, name: DriveName, verb: Verb, body: fields.CarryOut) -> Response:
    """Carry out a verb, such as read, status, start, stop, set_reference or write."""
    return await _carried_out(asked, body, body.arguments or {}, drive=find_drive(asked, name).name, verb=verb)


@route("POST", f"{_LINE}/drives/{{drive}}/{{verb}}", answers.Answer, named=True, local=True)
async def command_elsewhere(
    asked: ApiRequest, line: LineName, drive: fields.DriveAddress, verb: Verb, body: fields.CarryOut
) -> Response:
    """Read or stop a drive outside the plant, named as PROTOCOL:ADDRESS."""
    return await _carried_out(asked, body, body.arguments or {}, drive=drive, verb=verb, line=_line(asked, line))


async def _carried_out(asked: ApiRequest, body: fields.Fresh, arguments: Mapping[str, Any], **whom: Any) -> Response:
    fresh = body.model_dump(include=body.model_fields_set & _EVERY_COMMAND)
    doing = asked.plant.command(asked.caller, CommandRequest(arguments=arguments, **whom, **fresh))
    answer = await (_unless_gone(asked, doing) if whom["verb"] == "wait" else doing)
    if answer.error is None:
        return json_answer(answer_content(answer))
    if isinstance(answer.error, TooOftenError):
        raise answer.error
    # A failure at the drive gets the status of a gateway error, so that plain HTTP clients do not take it for success.
    status = {"failed": 502, "open": 504}.get(answer.outcome) or status_of(answer.error)
    return problem(status, answer.error, id=answer.id, outcome=answer.outcome, result=plain(answer.result))


async def _unless_gone(asked: ApiRequest, doing: Awaitable[CommandAnswer]) -> CommandAnswer:
    """Return the answer of a waiting command, or raise HTTPException when the client disconnects before."""
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


async def _gone(asked: ApiRequest) -> None:
    while (await asked.receive())["type"] != "http.disconnect":
        pass


@route("POST", f"{_LINE}/scan", form=Lines, role=Role.COMMISSION, named=True, local=True)
async def scan(asked: ApiRequest, line: LineName, body: fields.Scan) -> Response:
    """Scan a line for drives."""
    return _examined(asked, line, "scan", body.model_dump(exclude_unset=True))


@route("POST", f"{_LINE}/doctor", form=Lines, role=Role.COMMISSION, named=True, local=True)
async def doctor(asked: ApiRequest, line: LineName, body: fields.Doctor) -> Response:
    """Diagnose a line."""
    return _examined(asked, line, "doctor", body.model_dump(exclude_unset=True))


@route("GET", f"{_LINE}/trace", form=Lines, local=True)
async def trace(asked: ApiRequest, line: LineName) -> Response:
    """Telegrams of a line as they pass."""
    return _examined(asked, line, "trace", {})


@route("GET", f"{_LINE}/statistics", form=Lines, local=True)
async def statistics(asked: ApiRequest, line: LineName) -> Response:
    """Counters of a line."""
    return _examined(asked, line, "statistics", {})


def _examined(asked: ApiRequest, line: str, what: Examination, choices: Mapping[str, Any]) -> Response:
    return _lines(asked.plant.examine(asked.caller, _line(asked, line), what, choices))


def _line(asked: ApiRequest, name: str) -> str:
    try:
        return asked.plant.plant.line(name).name
    except UsageError as error:
        raise HTTPException(404, str(error)) from None


def _lines(items: AsyncIterator[Mapping[str, Any]]) -> Response:
    """Return a streamed response of one JSON object per line. An error of the source is sent as its last object."""

    async def told() -> AsyncIterator[str]:
        try:
            async for item in items:
                yield json_text(plain(item)) + "\n"
        except DriveCommError as error:
            yield json_text({"error": error_content(error)}) + "\n"

    return Lines(told())
