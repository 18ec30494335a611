"""What a VLT request is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_vlt3500.messages import Read, ReadIndex, Update

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Purpose


def purpose(request: Message) -> Purpose:
    """Tell by the command: U writes, R and I read, C only carries the control word."""
    if isinstance(request, Update):
        return "write"
    return "read" if isinstance(request, Read | ReadIndex) else "command"
