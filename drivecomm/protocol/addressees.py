"""Whom a request is for, as all protocols say it: by its field `address`, or by `broadcast`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol.contract import Protocol
    from drivecomm.protocol.telegram import Message


def is_broadcast(protocol: Protocol, request: Message) -> bool:
    """Return whether a request is for all drives."""
    address = getattr(request, "address", None)
    return getattr(request, "broadcast", False) is True or (
        address is not None and address == protocol.broadcast_address
    )


def is_for(protocol: Protocol, address: int, request: Message) -> bool:
    """Return whether a request is for the drive at an address, or for all drives."""
    return is_broadcast(protocol, request) or getattr(request, "address", None) == address
