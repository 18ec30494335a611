"""Execution of single link effects on a port, shared by all hosts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link import Arrival, Configure, Receive, Send

if TYPE_CHECKING:
    from drivecomm.link import Port, SingleEffect


def carry_out(effect: SingleEffect, port: Port) -> Arrival:
    """Carry out one effect, including its wait, and return its result."""
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
