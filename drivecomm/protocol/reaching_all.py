"""Checks whether one command to all drives of a protocol is right for each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.protocol.registry import installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


def commanded_by_model(protocol: str) -> bool:
    """Return whether the model of a drive decides how it is started and stopped. Raises UnknownProtocolError."""
    plugin = installed[protocol]
    return bool(plugin.control_keys) and not plugin.same_commands


def one_stop_fits_all(protocol: str, options: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether the stop of one of these drives stops the others as well when it is sent to all of them.

    options: the options of each drive, with its model. If the model decides the stop command, another series may
    understand it as something else: 2000H := 1 stops Delta drives, and starts those of INVT. Raises
    UnknownProtocolError.
    """
    return not commanded_by_model(protocol) or len({str(each.get("model")) for each in options}) == 1
