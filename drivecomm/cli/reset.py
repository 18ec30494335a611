"""The reset command."""

from __future__ import annotations

from drivecomm.cli.line_options import LineOptions
from drivecomm.cli.one_drive import done
from drivecomm.cli.options import Drive, Model


def reset(drive: Drive, line: LineOptions, model: Model = None) -> int:
    """Acknowledge a fault; this does not start the motor."""
    with line.drive(drive, model) as (one, name):
        one.reset()
        done(name, line, "reset")
    return 0
