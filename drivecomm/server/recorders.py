"""Interfaces of the recorders of a core: the audit of commands, and the history."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Reading
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandAnswer, CommandRequest
    from drivecomm.server.leases import Lease
    from drivecomm.server.observations import CurrentValue, Event


class AuditTrail(Protocol):
    """Interface to record commands and their outcomes, such as an `Audit`."""

    async def record_command(self, caller: Caller, command: CommandRequest, lease: Lease | None = None) -> int:
        """Record that a command is about to be sent; return the number of the record.

        Raises NotAllowedError if the record cannot be written.
        """

    def record_stop(self, caller: Caller, command: CommandRequest) -> int:
        """Queue the record of a stop and return its number; never waits."""

    def refused(self, caller: Caller, command: CommandRequest, why: str) -> None:
        """Queue the record of a refused command."""

    def outcome(self, caller: Caller, command: CommandRequest, number: int, answer: CommandAnswer) -> None:
        """Queue the record of a command's outcome."""


class HistoryRecorder(Protocol):
    """A recorder of values, events and commands, such as a `HistoryWriter`; its methods never wait."""

    @property
    def last_row(self) -> int:
        """The row of the latest value that is stored safely, 0 before the first one."""

    def add_values(self, values: Sequence[CurrentValue]) -> None:
        """Record values."""

    def add_events(self, events: Sequence[Event]) -> None:
        """Record events."""

    def add_command(
        self, caller: Caller, command: CommandRequest, answer: CommandAnswer, *, asked_s: float, done_s: float
    ) -> None:
        """Record a command and its outcome."""

    def add_fault_log(self, drive: str, entries: Sequence[Reading], *, time_s: float) -> None:
        """Record the fault log that was read from a drive, the newest entry first."""
