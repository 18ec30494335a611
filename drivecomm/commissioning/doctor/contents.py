"""Measurements of a line as plain content: for JSON, the command line, and messages between server and client."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivecomm.commissioning.doctor.measurements import Measurements
    from drivecomm.transport import PortReport


def measured_content(report: PortReport | None, found: Measurements) -> dict[str, Any]:
    """Return the report on a port, None if there is no report, and all measurements as plain content."""
    return {
        "report": report,
        "expected": [
            {
                "name": one.drive.name,
                "drive": f"{one.drive.protocol}:{one.drive.address}",
                "drive_name": one.drive.name,
                "settings": str(one.settings),
                "answers": not one.error,
                "elsewhere": str(one.elsewhere or ""),
                "needs": dict(one.needs),
                "answered_by": one.answered_by,
                "error": one.error,
            }
            for one in found.sought
        ],
        "panel": [
            {
                "drive": str(one.drive),
                "drive_name": one.drive.name,
                "setting": one.row.setting.parameter,
                "shown": one.shown,
                "wanted": one.row.right,
                "agrees": one.agrees,
            }
            for one in found.panel
        ],
        "noise": [
            {"settings": str(one.settings), "seconds": one.seconds, "data": one.data, "telegrams": one.telegrams}
            for one in found.noise
        ],
        "echo": [{"kind": one.kind, "sent": one.sent, "came": one.came, "took_s": one.took_s} for one in found.echo],
        "asked": {name: str(settings) for name, settings in found.asked.items()},
        "drives": [
            {
                "drive": one.name,
                "drive_name": one.name,
                "sound": one.sound,
                "identity": dict(one.identity),
                "detail": one.detail,
            }
            for one in found.found
        ],
        "elsewhere": [
            {"drive": one.name, "drive_name": one.name, "settings": str(settings)} for one, settings in found.elsewhere
        ],
        "replies": [
            {
                "drive": one.drive,
                "drive_name": one.drive,
                "asked": one.asked,
                "answered": len(one.times_s),
                "times_ms": [round(time * 1000, 3) for time in one.times_s],
                "wire_ms": [round(time * 1000, 3) for time in one.wire_s],
                "noise": [each.hex(" ").upper() for each in one.noise],
                "damaged": [each.hex(" ").upper() for each in one.damaged],
                "needs": dict(one.needs),
            }
            for one in found.replies
        ],
        "unclear_bytes": found.unclear_bytes,
    }
