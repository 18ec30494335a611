"""Which reply belongs to which request, what a request is for, and what the error numbers mean.

USS specification tables 4.1 to 4.3 and C-15: AK 0, the reply to an earlier task and a parameter change report mean "not
yet", and the task is repeated until its own reply comes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import Intent
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.words import VALID, has

if TYPE_CHECKING:
    from drivecomm.protocol import Message

_VALUES: dict[int, tuple[int, ...]] = {0: (0,), 1: (1, 2), 4: (3,), 5: (3,), 6: (4, 5), 9: (6,), 15: (15,)}
_VALUES |= {2: (1,), 14: (1,), 3: (2,), 13: (2,), 7: (4,), 12: (4,), 8: (5,), 11: (5,)}
READS, WRITES = (1, 4, 6, 9), (2, 3, 5, 7, 8, 11, 12, 13, 14)
_REPORTS = range(9, 13)

_ERRORS = {
    0: "illegal parameter number", 1: "parameter cannot be changed", 2: "limit violated", 3: "wrong index",
    4: "no array", 5: "wrong data type", 6: "setting not allowed, only reset", 7: "description cannot be changed",
    9: "description data not present", 11: "no operator rights", 12: "key word missing", 15: "no text array",
    17: "not possible in this operating state", 20: "value not allowed", 21: "answer too long",
    22: "wrong parameter address", 23: "wrong format", 24: "wrong number of values",
    101: "parameter deactivated at present", 102: "channel too narrow", 103: "wrong number of PKW",
    104: "value not allowed", 105: "parameter is indexed", 106: "task not implemented",
}  # fmt: skip
_FAMILIES = {
    "siemens": {200: "above the present limit", 201: "below the present limit", 204: "access rights do not cover it"},
    "g120": {
        0x86: "only in commissioning", 0x87: "know-how protection", 0xC8: "above the present limit",
        0xC9: "below the present limit", 0xCC: "access code needed",
    },
    "nord": {201: "invalid order label", 202: "reply label cannot be shown"},
}  # fmt: skip
FAMILIES = tuple(_FAMILIES)


def error_text(code: int, family: str) -> str:
    """Return the manuals' words for an error number; above 100 they differ between makers."""
    return (_ERRORS | _FAMILIES[family]).get(code, f"unlisted error {code}")


def mismatch(request: Message, reply: Message) -> str:
    """Name the first field in which a sound reply does not belong to a request; nothing when it belongs."""
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
    if reply.ak in _REPORTS:
        return "report"
    if request.ak and not reply.ak:
        return "pending"
    if request.ak:
        if (reply.pnu, reply.page or 0) != (request.pnu, request.page or 0):
            return "parameter"
        place = [(each.index or 0, each.parameter_set or 1, each.text_field or 1) for each in (request, reply)]
        if place[0] != place[1]:
            return "index"
    refusals = (() if request.ak == 0 else (7,)) + ((8,) if request.ak in (*WRITES, 15) else ())
    return "" if reply.ak in (*_VALUES.get(request.ak, ()), *refusals) else "ak"


def intent(request: Message) -> Intent:
    """Tell by AK what a request reads or writes, and by bit 10 of its control word whether it commands, too.

    A special telegram is passed over by all drives that know none (A-4, A-11), as those of all models here.
    """
    if not isinstance(request, Request) or request.broadcast:
        return Intent(commands=True)
    commands = has(request.control_word or 0, VALID)
    if not request.ak:
        return Intent(commands=commands)
    reads = request.ak in READS or (request.ak == 15 and request.text is None and not request.text_write)
    return Intent(access="read" if reads else "write", commands=commands)
