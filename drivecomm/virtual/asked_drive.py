"""A drive as a rehearsal asks it: parameters by their names, and its status as a server polls it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.line import STATUS
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.bus import BlockingLine, Drive


class AskedDrive:
    """A drive whose status is one of the things that a poll plan reads."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.name = drive.name
        self.facts = drive.facts

    @property
    def bus(self) -> BlockingLine:
        """The bus that it is on."""
        return self._drive.bus

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError for what can never be read."""
        if parameter != STATUS:
            self._drive.check_read(parameter, **options)

    def polled(self, parameter: str, **options: Any) -> Any:
        """Read a parameter, or the status."""
        if parameter != STATUS:
            return self._drive.polled(parameter, **options)
        status = self._drive.status()
        return Reading(parameter=STATUS, value=status.state.value, raw=status.word, time_s=self.bus.wall_time())

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return which of these parameters one telegram each reads, by their places in the list."""
        return self._drive.blocks(parameters)

    def polled_many(self, parameters: Sequence[str]) -> Any:
        """Read what `blocks` has put together."""
        return self._drive.polled_many(parameters)

    def read_many(self, parameters: Sequence[str]) -> Any:
        """Read what `blocks` has put together; in place of what the drive refuses are errors."""
        return self._drive.read_many(parameters)
