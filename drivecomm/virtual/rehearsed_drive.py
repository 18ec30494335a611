"""A drive as a rehearsal reads it: parameters by name, and its status as a server polls it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.line import STATUS
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.bus import BlockingLine, Drive


class RehearsedDrive:
    """A drive whose status can be an item of a poll plan."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.name = drive.name
        self.facts = drive.facts

    @property
    def bus(self) -> BlockingLine:
        """The bus of the drive."""
        return self._drive.bus

    def check_read(self, parameter: str, **options: Any) -> None:
        """Raise UsageError if the parameter can never be read."""
        if parameter != STATUS:
            self._drive.check_read(parameter, **options)

    def polled(self, parameter: str, **options: Any) -> Any:
        """Read a parameter, or the status."""
        if parameter != STATUS:
            return self._drive.polled(parameter, **options)
        status = self._drive.status()
        return Reading(parameter=STATUS, value=status.state.value, raw=status.word, time_s=self.bus.wall_time())

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return the groups of these parameters that one telegram reads, as positions in the list."""
        return self._drive.blocks(parameters)

    def polled_many(self, parameters: Sequence[str]) -> Any:
        """Read the parameters of one group from `blocks`."""
        return self._drive.polled_many(parameters)

    def read_many(self, parameters: Sequence[str]) -> Any:
        """Read the parameters of one group from `blocks`; a refused parameter gives an error in its place."""
        return self._drive.read_many(parameters)
