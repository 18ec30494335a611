"""Making virtual drives of any installed protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.drive_options import sort_out
from drivecomm.errors import AddressError
from drivecomm.models import load_model
from drivecomm.registry import installed

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.models import Model
    from drivecomm.protocol import VirtualDrive


def virtual_drive(
    protocol: str, address: int, *, model: str | Path | Model | None = None, **options: Any
) -> VirtualDrive:
    """Return a virtual drive that behaves as the protocol's manual says a real one does.

    model: its parameters and start values, the protocol's own default if absent. options: its line settings (baudrate,
    parity, ...), its gap_s, and the protocol's drive options. Raises UsageError for anything that cannot be.
    """
    plugin = installed[protocol]
    if address not in plugin.addresses:
        raise AddressError(f"{protocol} has no drive at address {address}")
    known = load_model(plugin.package, protocol, model or plugin.default_model)
    facts, chosen = sort_out(plugin, known, options)
    drive = plugin.virtual(address, chosen, known)
    drive.settings = facts.settings
    drive.gap_s = facts.gap_s
    return drive
