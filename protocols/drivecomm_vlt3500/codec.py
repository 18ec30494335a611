"""Messages made from fields, intents of requests, matching of replies, and undetected bit errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol import Intent, difference
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.messages import Control, ControlReply, Reply, Request, Update
from drivecomm_vlt3500.parameters import number
from drivecomm_vlt3500.telegrams import UNCHECKED, telegrams

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction, Message

_CHECK = slice(19, 21)


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Return a message from fields with the names that test vectors use: exact decimals as text, an index as a list."""
    rest, kind = dict(given), given.get("kind")
    if rest.get("value") is not None:
        try:
            rest["value"] = number(rest["value"])
        except (TypeError, ValueError) as error:
            raise TelegramError("field", f"{kind} telegram: {error}") from None
    message = telegrams().message(rest, direction)
    if isinstance(message, Reply) and message.value is None and message.fault_code is None:
        raise TelegramError("field", f"the {kind} telegram also needs value or fault_code", field="value")
    return message


def intent(request: Message) -> Intent:
    """Return the intent of a request: U writes, R and I read.

    Each request is also a command unless bit 10 of its control word is given as 0.
    """
    if not isinstance(request, Request):
        return Intent(commands=True)
    given = request.control_mask is None or bool(request.control_mask & words.VALID)
    commands = not given or bool(request.control_word & words.VALID)
    if isinstance(request, Control):
        return Intent(commands=commands)
    return Intent(access="write" if isinstance(request, Update) else "read", commands=commands)


def mismatch(request: Message, reply: Message) -> str:
    """Return the mismatch between a request and a sound reply; empty if the reply belongs to the request.

    A reply is a copy of its request with the status word in it (VLT 3500 manual, page 85). The value of an update may
    differ, because the drive rounds and limits. "sign": byte 13 of the reply has bit 7 set, so it may be a `-` with a
    wrong bit that the sum does not detect. "checksum": the reply switches the check off and the request did not.
    "echo": the reply is the request, handed back.
    """
    if not isinstance(request, Request) or not isinstance(reply, Reply | ControlReply):
        return "kind"
    compared = ("address", "kind", "parameter") if isinstance(reply, Reply) else ("address", "kind")
    if differs := difference(request, reply, *compared):
        return differs
    if isinstance(reply, Reply) and reply.sign is not None and not reply.sign.isascii():
        return "sign"
    if reply.unchecked and not request.unchecked:
        return "checksum"
    if reply.status_word == request.control_word and _encode(reply) == _encode(request):
        return "echo"
    return ""


def blind_spots(data: bytes, direction: Direction) -> frozenset[int]:  # noqa: ARG001 - same in both directions
    """Return the positions where one wrong bit is not detected.

    There are none while the sum is present: one bit changes it by 1, 2, 4, ... 64 or 128, never by a multiple of 100.
    With `??`, all positions between start and check characters, except the control character, because no two of these
    differ in only one bit.
    """
    if data[_CHECK] != UNCHECKED:
        return frozenset()
    return frozenset(range(1, 19)) - {3}


_encode = telegrams().encode
