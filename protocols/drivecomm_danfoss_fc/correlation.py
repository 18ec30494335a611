"""Which reply belongs to which request (specification, section 6.2), and what a request is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import Intent, difference
from drivecomm_danfoss_fc.messages import (
    REPLIES,
    REQUESTS,
    ParameterRequest,
    ProcessReply,
    ProcessRequest,
    TextRequest,
)
from drivecomm_danfoss_fc.tables import table
from drivecomm_danfoss_fc.words import VALID_BIT, has

if TYPE_CHECKING:
    from drivecomm.protocol import Message

_REFUSALS = (0, 7)
_LISTED_RESPONSES = (0, 1, 2, 3, 7, 15)
_NO_ACCESS, _TEXT = 0, 15
_READING_TEXT = frozenset([0x00, 0x04])
"""High bytes of IND with which a text is read and not written (specification, section 8)."""


def intent(request: Message) -> Intent:
    """Tell by AK what a request reads or writes, and by bit 10 of its control word whether it commands, too."""
    if not isinstance(request, REQUESTS):
        return Intent(commands=True)
    commands = has(request.control_word, VALID_BIT)
    if isinstance(request, ProcessRequest):
        return Intent(commands=commands)
    if request.ak == _TEXT:
        reads = isinstance(request, ParameterRequest) and request.ind >> 8 in _READING_TEXT
        return Intent(access="read" if reads else "write", commands=commands)
    access = table("commands").get(request.ak, {}).get("access", "")
    return Intent(access=access, commands=commands or (not access and request.ak != _NO_ACCESS))


def mismatch(request: Message, reply: Message) -> str:
    """Name the first field in which a sound reply does not belong to a request; nothing when it belongs.

    The whole ADR is compared, the address format too: a drive hands it back unchanged (seeds 001 and 004). An AK that
    no response table lists is let through, so that the exchange can report it (specification, section 15, no. 29).
    """
    if not isinstance(request, REQUESTS) or not isinstance(reply, REPLIES):
        return "kind"
    if difference(request, reply, "address", "address_format", "broadcast"):
        return "address"
    if isinstance(request, ProcessRequest) or isinstance(reply, ProcessReply):
        return "" if isinstance(request, ProcessRequest) and isinstance(reply, ProcessReply) else "kind"
    if reply.pnu != request.pnu:
        return "pnu"
    if isinstance(request, TextRequest):
        # What answers a text write is printed nowhere: AK decides alone (specification, section 8).
        return "ak" if reply.ak == 3 else ""
    known = table("commands").get(request.ak, {})
    if (reply.ind ^ request.ind) & (0x00FF if known.get("indexed") else 0xFFFF):
        return "ind"
    legal = reply.ak not in _LISTED_RESPONSES or reply.ak in known.get("answers", _REFUSALS)
    return "" if legal else "ak"
