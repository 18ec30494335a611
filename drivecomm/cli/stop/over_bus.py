"""A line that the command line stops, and all drives of a protocol where no plant file says which there are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.bus import DrivesToStop, StopResult, carry_out, stopping_everybody
from drivecomm.errors import NotSupported, ServerLostError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import BlockingLine, OnResult
    from drivecomm.protocol import Stop


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedLine(DrivesToStop):
    """What is to be stopped on a line, and how the line is reached."""

    port: str | None
    opening: Mapping[str, Any]
    file: str = ""
    """The real path of the plant file that says so: its server needs to be told what was said here only."""

    said: Mapping[str, Any] = field(default_factory=dict)
    """What was said here: line facts of the command line."""


def stop_protocol_of(bus: BlockingLine, name: str, how: Stop, tell: OnResult, *, as_json: bool) -> list[str]:
    """Stop all drives of a protocol; return its name where that can be done one by one only."""
    unreached = []
    try:
        try:
            # One after the other: the first has been stopped before the second is loaded.
            everybody = bus.broadcast(name)
            told = carry_out(None, stopping_everybody(everybody, "", name, how))
        except NotSupported as error:
            # Such as Modbus, where their model says how drives are stopped, or drives without a broadcast.
            unreached.append(name)
            if not as_json:
                return unreached
            told = StopResult(protocol=name, how=how, error=error)
    except ServerLostError:
        # Another way is left.
        raise
    except Exception as error:  # noqa: BLE001 - a package that is broken keeps no drive of another one running
        told = StopResult(protocol=name, how=how, error=error)
    tell(told)
    return unreached
