"""What a VABus request is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_vabus.telegrams import Enquiry, Select

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Purpose


def purpose(request: Message) -> Purpose:
    """Tell reading from writing; control word and reference are parameters too, EOT only ends a conversation."""
    if isinstance(request, Enquiry):
        return "read"
    return "write" if isinstance(request, Select) else "command"
