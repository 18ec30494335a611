"""Making virtual drives of any installed protocol."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from drivecomm.errors import AddressError, UsageError
from drivecomm.line import LINE_FACT_NAMES
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
    own = {field.name for field in fields(plugin.options)}
    unknown = sorted(set(options) - own - LINE_FACT_NAMES)
    if unknown:
        raise UsageError(f"{protocol} drives have no option {unknown[0]!r}; they have {', '.join(sorted(own))}")
    chosen = {**{name: value for name, value in known.options.items() if name in own}, **options}
    drive = plugin.virtual(address, plugin.options(**{name: chosen[name] for name in chosen if name in own}), known)
    facts = plugin.facts.override({name: options[name] for name in options if name in LINE_FACT_NAMES})
    drive.settings = facts.settings
    drive.gap_s = facts.gap_s
    return drive
