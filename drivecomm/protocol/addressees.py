"""Addressing in all protocols: the field `address` or `broadcast` of a request says for which drives it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol.contract import Protocol
    from drivecomm.protocol.telegram import Message
    from drivecomm.protocol.virtual_drive import VirtualDrive


def is_broadcast(protocol: Protocol, request: Message) -> bool:
    """Return whether a request is for all drives."""
    address = getattr(request, "address", None)
    return getattr(request, "broadcast", False) is True or (
        address is not None and address == protocol.broadcast_address
    )


def is_for(protocol: Protocol, drive: VirtualDrive, request: Message) -> bool:
    """Return whether a request is for a drive: for it alone, for a group with it, or for all drives."""
    address = getattr(request, "address", None)
    is_shared = address is not None and address in getattr(drive, "shared_addresses", ())
    return is_shared or is_broadcast(protocol, request) or address == drive.address
