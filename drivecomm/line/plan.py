"""Poll plan before any port is open: the drives, their lines, and the parameters to read with their periods."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.line.poll_items import D, PollItem

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PollPlan:
    """The parameters to read, in the order of a round."""

    reads: tuple[PollItem[DriveConfig], ...]

    def __post_init__(self) -> None:
        if not self.reads:
            raise UsageError("a poll plan needs at least one parameter")
        names = [drive.name for drive in self.drives]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise UsageError(f"two drives of the plan are named {twice}; give each a name of its own")

    @property
    def drives(self) -> tuple[DriveConfig, ...]:
        """The drives in the order of their first read."""
        return tuple(dict.fromkeys(read.drive for read in self.reads))

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines in the order of their first read; "" for drives without a line."""
        return tuple(dict.fromkeys(drive.line for drive in self.drives))

    def on_line(self, line: str) -> PollPlan:
        """Return the part of the plan on one line."""
        return PollPlan(reads=tuple(read for read in self.reads if read.drive.line == line))

    def with_drives(self, change: Callable[[DriveConfig], DriveConfig]) -> PollPlan:
        """Return the plan with each drive replaced by `change(drive)`."""
        changed = {drive: change(drive) for drive in self.drives}
        return PollPlan(reads=tuple(replace(read, drive=changed[read.drive]) for read in self.reads))

    def items(self, make: Callable[[DriveConfig], D]) -> list[PollItem[D]]:
        """Return the items for a poll loop. make: called once for each drive; returns the object to read."""
        made = {drive: make(drive) for drive in self.drives}
        return [
            PollItem(
                drive=made[read.drive],
                parameter=read.parameter,
                period_s=read.period_s,
                priority=read.priority,
                stale_after_s=read.stale_after_s,
                options=read.options,
                name=read.drive.name,
            )
            for read in self.reads
        ]
