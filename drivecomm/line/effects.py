"""Carrying out single effects of a link on a port, for every host."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link import Arrival, Configure, Receive, Send

if TYPE_CHECKING:
    from drivecomm.link import Port, SingleEffect


def carry_out(effect: SingleEffect, port: Port) -> Arrival:
    """Carry out one effect, waiting as long as it says, and return what came of it."""
    data, note = b"", ""
    if isinstance(effect, Receive):
        data = port.read(effect.until, effect.at_least)
    elif isinstance(effect, Send):
        port.write(effect.data)
    elif isinstance(effect, Configure):
        note = port.configure(effect.settings)
    elif port.now() < effect.until:
        port.wait(effect.until)
    return Arrival(port.now(), data, note)
