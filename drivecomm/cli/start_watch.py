"""Output of a start command about the motor that it keeps."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from drivecomm.bus import KeepReports
from drivecomm.cli.output import complain, labels, tell

if TYPE_CHECKING:
    from threading import Event

    from drivecomm.errors import DriveCommError
    from drivecomm.protocol import DriveConfig


def news_shown(name: DriveConfig, stop: Event, *, as_json: bool) -> KeepReports:
    """Return a display of the events of a kept motor. stop: set on a fault of the drive, which ends the command."""

    def show(done: str, text: str, **further: object) -> None:
        tell(f"{name.name}  {text}", as_json=as_json, **labels(name), done=done, **further)

    def show_error(error: DriveCommError) -> None:
        complain(error, as_json=as_json, where=time.strftime("%H:%M:%S"))

    return KeepReports(show, show_error, stop.set)
