"""What a request to a Fuji inverter is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm_fuji.telegrams import Poll, Select, Standard

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Purpose

_ALARM_RESET = {Standard: "E", Select: "m"}


def purpose(request: Message) -> Purpose:
    """Tell by frame and command; the alarm reset is the only command that is no function code."""
    if isinstance(request, Standard | Select) and request.command == _ALARM_RESET[type(request)]:
        return "command"
    if isinstance(request, Poll):
        return "read"
    return "read" if isinstance(request, Standard) and request.command == "R" else "write"
