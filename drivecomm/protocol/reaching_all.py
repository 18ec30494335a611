"""Whether what is said to all drives of a protocol at once is right for each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.protocol.registry import installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


def commanded_by_model(protocol: str) -> bool:
    """Whether it is the model of a drive that says what starts and stops it. Raises UnknownProtocolError."""
    plugin = installed[protocol]
    return bool(plugin.control_keys) and not plugin.same_commands


def one_stop_fits_all(protocol: str, options: Iterable[Mapping[str, Any]]) -> bool:
    """Whether what stops one of these drives of a protocol, sent to all, stops the others as well.

    options: of each of them, with its model. Where the model says what stops a drive, another series may take it for
    something else: 2000H := 1 stops Delta drives, and starts those of INVT. Raises UnknownProtocolError.
    """
    return not commanded_by_model(protocol) or len({str(each.get("model")) for each in options}) == 1
