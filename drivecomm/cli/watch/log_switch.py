"""Value log of a watch, which a key switches on and off."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.plant.value_log import open_log

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.line import PollResult
    from drivecomm.plant.value_log import ValueLog


class LogSwitch:
    """Log that can be switched on and off. path: its file; None for a file in this folder named after the time."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._log: ValueLog | None = None
        self.is_on = False
        self.said: Callable[[str], None] = lambda _: None
        """Called when values cannot be logged for lack of disk space, and when they can again; set before `switch`."""

    def switch(self) -> str:
        """Switch the log on or off; return a message. Raises DriveCommError if the file cannot be written."""
        if self.is_on:
            self.is_on = False
            return f"logging is paused; {self._name} is finished when watch ends"
        if self._log is None:
            path = self._path or Path(f"watch-{datetime.now(UTC):%Y%m%d-%H%M%S}.csv")
            self._log = open_log(path, tell=self.said)
        self.is_on = True
        return f"logging to {self._name}"

    def tell(self, result: PollResult) -> None:
        """Write a result if the log is on."""
        if self.is_on and self._log is not None:
            self._log.write(result)

    @property
    def words(self) -> str:
        """State of the log, for the title of the screen."""
        if self.is_on:
            missing = f", {self._log.missing} missing" if self._log is not None and self._log.missing else ""
            return f"log {self._name}{missing}"
        return "log paused" if self._log is not None else "log off"

    def close(self) -> str:
        """Complete the file; return a message on missing rows or on the failure, empty on success."""
        if self._log is None:
            return ""
        log, self._log, self.is_on = self._log, None, False
        try:
            log.close()
        except (DriveCommError, OSError) as error:
            return str(error)
        return log.summary

    @property
    def _name(self) -> str:
        return self._log.path.name if self._log is not None else ""
