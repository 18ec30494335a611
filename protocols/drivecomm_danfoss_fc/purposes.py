"""What an FC request is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_danfoss_fc import access
from drivecomm_danfoss_fc.messages import ParameterRequest, TextRequest

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Purpose

_READS = frozenset([access.READ, access.READ_ELEMENT])
_WRITES = frozenset([access.WRITE_WORD, access.WRITE_DOUBLE, access.STORE_WORD, access.STORE_DOUBLE])


def purpose(request: Message) -> Purpose:
    """Tell by the command (AK); a telegram without one only carries control word and reference."""
    if not isinstance(request, ParameterRequest | TextRequest):
        return "command"
    if request.ak == access.TEXT:
        return "write" if request.ind & 0xFF00 == access.WRITE_TEXT else "read"
    if request.ak in _READS:
        return "read"
    return "write" if request.ak in _WRITES else "command"
