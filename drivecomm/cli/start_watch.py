"""What a start command tells of the drive that it keeps in hand."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from drivecomm.cli.output import complain, labels, tell

if TYPE_CHECKING:
    from threading import Event

    from drivecomm.errors import DriveCommError
    from drivecomm.protocol import DriveConfig, DriveStatus


class Watch:
    """Tells what happens to a drive that is kept in hand, each thing once."""

    def __init__(self, name: DriveConfig, stop: Event, *, as_json: bool) -> None:
        self._name = name
        self._stop = stop
        self._as_json = as_json
        self._failing = ""
        self.fault = False

    def tell(self, *, done: str, text: str, **further: object) -> None:
        """Say what has been done."""
        tell(f"{self._name.name}  {text}", as_json=self._as_json, **labels(self._name), done=done, **further)

    def failed(self, error: DriveCommError) -> None:
        """Say that the drive could not be spoken to."""
        if str(error) != self._failing:
            self._failing = str(error)
            complain(error, as_json=self._as_json, where=time.strftime("%H:%M:%S"))

    def answered(self, status: DriveStatus) -> None:
        """Take note of how the drive is; a fault ends it."""
        if self._failing:
            self._failing = ""
            self.tell(done="answers again", text="answers again")
        if status.fault and not self.fault:
            self.fault = True
            fault = " ".join(str(part) for part in (status.fault_code, status.fault_text) if part)
            self.tell(done="fault", text=f"has a fault{f' ({fault})' if fault else ''}", fault_code=status.fault_code)
            self._stop.set()
