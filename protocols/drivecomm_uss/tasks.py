"""Tasks and replies: their contents, the replies to each task, and the error numbers; tasks.toml has the tables.

AK 0, the reply to an earlier task and a parameter change report all mean "not yet", and the task is repeated until its
own reply comes (USS specification C-15).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.protocol import Intent, tables_beside
from drivecomm_uss.messages import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles import ControlProfile
    from drivecomm.protocol import Direction, Message

NO_NUMBER, READ_ONLY, LIMIT, NO_INDEX, NO_ARRAY, WRONG_TYPE = range(6)
HOW_MANY, INDEXED = 24, 105
"""Error numbers of reply 7 that tasks.toml explains; those that differ between manufacturers are in ANSWERS."""

_TABLES = tables_beside(__file__, "tasks.toml")
ANSWERS = _TABLES["answers"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UssTask:
    """Properties of a task or a reply, named as in tasks.toml."""

    carries: str = ""
    bits: int = 0
    array: bool = False
    report: bool = False
    reserved: bool = False
    stored: bool = False
    refused: int = 0
    access: str = ""
    answers: list[int] | tuple[()] = ()


TASKS: dict[Direction, dict[int, UssTask]] = {
    "request": {int(ak): UssTask(**each) for ak, each in _TABLES["request"].items()},
    "reply": {int(ak): UssTask(**each) for ak, each in _TABLES["reply"].items()},
}


def profile() -> ControlProfile:
    """Return the control profile; its file is read only when a drive is commanded, not when a parameter is read."""
    return profiles.control_profile("profidrive")


def task_that_writes(*, array: bool, double: bool, stored: bool) -> int:
    """Return the task that writes a value of this kind."""
    wanted = ("write", array, 32 if double else 16, stored)
    tasks = TASKS["request"].items()
    return next(ak for ak, each in tasks if (each.access, each.array, each.bits, each.stored) == wanted)


def error_text(code: int, family: str) -> str:
    """Return the manuals' text for an error number; numbers above 100 differ between manufacturers."""
    return error_texts(family).get(code, f"unlisted error {code}")


def error_texts(family: str) -> Mapping[int, str]:
    """Return the manuals' texts for all error numbers of a family."""
    errors = _TABLES["errors"]
    return {int(code): str(text) for code, text in (errors["all"] | errors[family]).items()}


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs."""
    if not isinstance(request, Request) or not isinstance(reply, Reply):
        return "kind"
    if reply.address != request.address:
        return "address"
    if reply.kind != request.kind:
        return "kind"
    if request.mirror:
        return "" if reply.data == request.data else "mirror"
    if request.ak is None or reply.ak is None:
        return ""
    if reply.ak in TASKS["reply"] and TASKS["reply"][reply.ak].report:
        return "report"
    if request.ak:
        if not reply.ak:
            return "pending"
        if (reply.pnu, reply.page or 0) != (request.pnu, request.page or 0):
            return "parameter"
        place = [(each.index or 0, each.parameter_set or 1) for each in (request, reply)]
        if place[0] != place[1] or reply.text_field not in (None, request.text_field or 1):
            return "index"
    return "" if reply.ak in TASKS["request"][request.ak].answers else "ak"


def intent(request: Message) -> Intent:
    """Return the intent of a request: AK shows reads and writes, bit 10 of the control word shows a command.

    A special telegram is ignored by all drives that support none (A-4, A-11), which includes those of all models here.
    """
    if not isinstance(request, Request) or request.broadcast:
        return Intent(commands=True)
    commands = bool(request.control_word) and profile().commands(request.control_word or 0)
    if not request.ak:
        return Intent(commands=commands)
    access = TASKS["request"][request.ak].access
    reads = access == "read" or (access == "text" and request.text is None and not request.text_write)
    return Intent(access="read" if reads else "write", commands=commands)
