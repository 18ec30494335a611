"""Strict parsing of received commands, stops and requests, field by field. No I/O, no clock."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.client import parsed
from drivecomm.errors import UsageError, shortened, unknown_key
from drivecomm.protocol import Stop
from drivecomm.server import NEEDS, CommandRequest

if TYPE_CHECKING:
    from collections.abc import Mapping

LONGEST = 16 * 1024
"""Maximum bytes of a message, far above any command."""
_LONGEST_TEXT = 4096


class Field(NamedTuple):
    """Field of a message: its Python types, and the words in which an error describes it."""

    types: tuple[type, ...]
    words: str


_TEXT = Field((str,), f"a text of {_LONGEST_TEXT} characters at most")
_NUMBER = Field((int, Decimal), "a number")
_COMMAND = {
    "id": _TEXT,
    "verb": _TEXT,
    "arguments": Field((dict,), "an object"),
    "lease": _TEXT,
    "issued_s": Field((int, Decimal), "seconds since 1970"),
    "valid_s": _NUMBER,
    "session": _TEXT,
    "token": _TEXT,
}
_KINDS_OF_STOP = frozenset(each.value for each in Stop)
_STOP = {"id": _TEXT, "how": _TEXT, "token": _TEXT, "session": _TEXT, "issued_s": _NUMBER, "valid_s": _NUMBER}
REQUESTS: Mapping[str, Mapping[str, Field]] = {
    "stop": {**_STOP, "lines": Field((list,), "a list of names of lines")},
    "lease/take": {"id": _TEXT, "session": _TEXT, "token": _TEXT, "drive": _TEXT, "seconds": _NUMBER},
    "lease/renew": {"id": _TEXT, "session": _TEXT, "token": _TEXT, "drive": _TEXT, "seconds": _NUMBER, "key": _TEXT},
    "lease/end": {"id": _TEXT, "session": _TEXT, "token": _TEXT, "drive": _TEXT, "key": _TEXT},
    "acknowledge": {"id": _TEXT, "session": _TEXT, "token": _TEXT, "alarm": _TEXT},
}
"""Requests about the plant as a whole, with their fields. All fields but token and lines are required."""

_SAID = {
    "id": "a unique text, so that a repeated command is sent once",
    "session": "the session in bridge/state, which ties the command to this connection",
    "issued_s": "the time of the command, so that it is not sent late",
    "valid_s": "its validity in seconds",
}


def parse_fields(payload: bytes, fields: Mapping[str, Field]) -> dict[str, Any]:
    """Return the fields of a message. Raises UsageError if it is not JSON or has unknown or wrong fields."""
    if len(payload) > LONGEST:
        raise UsageError(f"the message has more than {LONGEST} bytes")
    try:
        content = parsed(payload)
    except (ValueError, ArithmeticError, RecursionError):
        raise UsageError("the message is not JSON") from None
    if not isinstance(content, dict):
        raise UsageError("the message is not a JSON object; give it in braces")
    for name, value in content.items():
        field = fields.get(name)
        if field is None:
            raise UsageError(unknown_key(name[:_LONGEST_TEXT], fields))
        if not _fits(value, field):
            raise UsageError(f"invalid {name} = {shortened(value)}; give {field.words}")
    return content


def _fits(value: Any, field: Field | None) -> bool:
    """Whether a field can hold this value."""
    if field is None or not isinstance(value, field.types) or isinstance(value, bool):
        return False
    return not isinstance(value, str) or len(value) <= _LONGEST_TEXT


def command_of(drive: str, content: Mapping[str, Any]) -> CommandRequest:
    """Return the command in a message; missing fields get default values."""
    # Without a session: the door has checked the session of the message, which is that of its connection.
    return CommandRequest(
        drive=drive,
        verb=content.get("verb", ""),
        arguments=content.get("arguments", {}),
        id=content.get("id", ""),
        lease=content.get("lease", ""),
        issued_s=_seconds(content.get("issued_s")),
        valid_s=_seconds(content.get("valid_s")) or 0.0,
    )


def parse_command(payload: bytes) -> dict[str, Any]:
    """Return the fields of a message on a command topic. Raises UsageError."""
    return parse_fields(payload, _COMMAND)


def parse_stop(payload: bytes, fields: Mapping[str, Field] = _STOP) -> dict[str, Any]:
    """Return the fields of a stop, which may be empty, a single word such as coast, or an object.

    Invalid parts are dropped: an unintelligible stop is still carried out, as a ramp.
    """
    word = payload.strip().strip(b'"').decode("ascii", "replace").lower().replace("-", "_")
    if word in _KINDS_OF_STOP:
        return {"how": word}
    try:
        given = parsed(payload) if len(payload) <= LONGEST else None
    except (ValueError, ArithmeticError, RecursionError):
        given = None
    content = (
        {}
        if not isinstance(given, dict)
        else {key: each for key, each in given.items() if _fits(each, fields.get(key))}
    )
    if content.get("how") not in _KINDS_OF_STOP:
        content.pop("how", None)
    if not all(isinstance(each, str) for each in content.get("lines", ())):
        del content["lines"]
    return content


def parse_plant_request(what: str, payload: bytes) -> dict[str, Any]:
    """Return the fields of a request. Raises UsageError, also for an unknown request or a missing field."""
    fields = REQUESTS.get(what)
    if fields is None:
        raise UsageError(unknown_key(what, REQUESTS).replace("key", "request"))
    if what == "stop":
        return parse_stop(payload, fields)
    content = parse_fields(payload, fields)
    for name in fields:
        if name != "token" and name not in content:
            raise UsageError(f"the field {name!r} is missing; give {_SAID.get(name, fields[name].words)}")
    return content


def why_incomplete(content: Mapping[str, Any]) -> str:
    """Return an error text if a command lacks a field that proves it is fresh; "" if it is complete."""
    verb = content.get("verb")
    if not verb:
        return "the field 'verb' is missing; give a verb, such as start"
    needed = _SAID if verb not in NEEDS or NEEDS[verb].commands else ("id",)
    missing = [name for name in needed if not content.get(name)]
    if not missing:
        return ""
    return f"the field {missing[0]!r} is missing; give {_SAID[missing[0]]}"


def _seconds(value: Any) -> float | None:
    try:
        return None if value is None else float(value)
    except OverflowError:
        return float("inf")
