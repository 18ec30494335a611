"""A poll plan before any port is open: which drives, on which lines, and what is read of them how often."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.polling.schedule import PollItem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import Bus, Drive

LONGEST_DELAY_S = 60.0
"""The longest time until a reply that a plan accepts, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedDrive:
    """A drive of a plan.

    protocol, address: which. options: what `Bus.drive` takes, such as model=, baudrate= and the protocol's own. name:
    what the plan and its results call it, PROTOCOL:ADDRESS if empty. port: its line; empty for the line of those who
    name none. reply_delay_s: from the end of a request to the begin of its reply, for a forecast; the protocol's
    virtual drive knows one if absent.
    """

    protocol: str
    address: int
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    name: str = ""
    port: str = ""
    reply_delay_s: float | None = None

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"{self.protocol}:{self.address}")
        if self.reply_delay_s is not None and not 0 <= self.reply_delay_s < LONGEST_DELAY_S:
            raise UsageError(f"a reply delay of {self.reply_delay_s} s is not between 0 and {LONGEST_DELAY_S:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRead:
    """A parameter of a plan; period_s, priority and options are those of a `PollItem`."""

    drive: PlannedDrive
    parameter: str
    period_s: float = 1.0
    priority: int = 0
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is read, in the order in which a round goes."""

    reads: tuple[PlannedRead, ...]

    def __post_init__(self) -> None:
        if not self.reads:
            raise UsageError("a poll plan needs at least one parameter")
        names = [drive.name for drive in self.drives]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise UsageError(f"two drives of the plan are named {twice}; give each a name of its own")

    @property
    def drives(self) -> tuple[PlannedDrive, ...]:
        """The drives in the order in which they come up."""
        return tuple(dict.fromkeys(read.drive for read in self.reads))

    @property
    def ports(self) -> tuple[str, ...]:
        """The lines in the order in which they come up; the one without a name is empty."""
        return tuple(dict.fromkeys(drive.port for drive in self.drives))

    def on_line(self, port: str) -> Plan:
        """Return the part of the plan that is on one line."""
        return Plan(reads=tuple(read for read in self.reads if read.drive.port == port))

    def items(self, buses: Mapping[str, Bus]) -> list[PollItem[Drive]]:
        """Return the plan for open lines, by port. Raises UsageError for drives and options that cannot be."""
        drives = {
            planned: buses[planned.port].drive(planned.protocol, planned.address, **planned.options)
            for planned in self.drives
        }
        return [
            PollItem(
                drive=drives[read.drive],
                parameter=read.parameter,
                period_s=read.period_s,
                priority=read.priority,
                options=read.options,
                name=read.drive.name,
            )
            for read in self.reads
        ]
