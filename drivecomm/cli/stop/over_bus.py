"""Line to stop on the command line, and the stop of all drives of a protocol without a plant file."""

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
    """Drives to stop on a line, and the way to reach the line."""

    port: str | None
    opening: Mapping[str, Any]
    file: str = ""
    """Real path of the plant file; its server needs only the options of the command line."""

    said: Mapping[str, Any] = field(default_factory=dict)
    """Line facts of the command line."""


def stop_protocol_of(bus: BlockingLine, name: str, how: Stop, tell: OnResult, *, as_json: bool) -> list[str]:
    """Stop all drives of a protocol; return its name if its drives can only be stopped one by one."""
    unreached = []
    try:
        try:
            # One protocol at a time: the first one is stopped before the second one is imported.
            everybody = bus.broadcast(name)
            told = carry_out(None, stopping_everybody(everybody, "", name, how))
        except NotSupported as error:
            # For example Modbus, where the model defines the stop, or drives without a broadcast.
            unreached.append(name)
            if not as_json:
                return unreached
            told = StopResult(protocol=name, how=how, error=error)
    except ServerLostError:
        # The caller then tries another way to stop the drives.
        raise
    except Exception as error:  # noqa: BLE001 - a broken package must not block the stops of other protocols
        told = StopResult(protocol=name, how=how, error=error)
    tell(told)
    return unreached
