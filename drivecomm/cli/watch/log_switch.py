"""The log of a watch, which a key switches on and off."""

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
    """Keeps a log or does not. path: the file; None for one in this folder that is named after the time."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._log: ValueLog | None = None
        self.is_on = False
        self.said: Callable[[str], None] = lambda _: None
        """Hears when values cannot be logged for want of room, and when they are again; set before it is switched."""

    def switch(self) -> str:
        """Switch it on or off; return what to say. Raises DriveCommError for a file that cannot be."""
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
        """How it is, for the head of the screen."""
        if self.is_on:
            missing = f", {self._log.missing} missing" if self._log is not None and self._log.missing else ""
            return f"log {self._name}{missing}"
        return "log paused" if self._log is not None else "log off"

    def close(self) -> str:
        """Finish the file; return what is missing in it, or why it cannot be finished, empty when all is well."""
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
