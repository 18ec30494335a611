"""What a server knows of its plant, as values that do not change: current values, drives, lines, and what happened."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.line import FRESH
from drivecomm.link import Statistics
from drivecomm.protocol import maker
from drivecomm.server.drift_state import NOT_COMPARED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.line import ResultQuality
    from drivecomm.plant.watching import Reachability
    from drivecomm.protocol import DriveConfig, DriveStatus, LinkLoss, MachineUnit, MachineValue, Reading, Stop
    from drivecomm.server.drift_state import DriveDrift
    from drivecomm.server.leases import Lease


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentValue:
    """The latest of one quantity of one drive.

    drive: its name in the plant. name: as the plant polls it, an address or a common name. reading: the last good one,
    None where there is none that is young enough; its time is the source's. quality: good, uncertain, stale or bad,
    when it was put into the table. cause: why there is none now. time_s: when this was found out, in seconds since
    1970. keeps_s: how old it may become before nobody shall take it for current. unreadable: by what the plant file
    and the model say, this drive has no such quantity. machine: the unit of the drive's machine, None without one.
    """

    drive: str
    name: str
    reading: Reading | None
    quality: ResultQuality
    cause: str = ""
    time_s: float
    keeps_s: float = 3.0
    unreadable: bool = False
    machine: MachineUnit | None = None

    @property
    def source_s(self) -> float | None:
        """When the reply with the value had arrived, None without a value."""
        return None if self.reading is None else self.reading.time_s

    @property
    def remark(self) -> str:
        """Why there is no value now, or what is to be known about the one there is."""
        return self.cause or ("" if self.reading is None else self.reading.remark)

    @property
    def at_machine(self) -> MachineValue | None:
        """The machine's speed for a frequency of a drive that has a machine; None for any other value."""
        return None if self.machine is None or self.reading is None else self.machine.beside(self.reading)

    def quality_at(self, time_s: float) -> ResultQuality:
        """Return what the value is worth at a time: a fresh one is stale once it is older than it keeps.

        A server that hangs marks nothing as stale; and a clock that was set makes no value young for long.
        """
        source_s = self.source_s
        if self.quality in FRESH and (source_s is None or abs(time_s - source_s) > self.keeps_s):
            return "stale"
        return self.quality


new_value = maker(CurrentValue)
"""Returns a CurrentValue, as its constructor does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RememberedFault:
    """A fault in a drive's own log. place: 1 for the newest. value: its code. time_s: when the drive was asked."""

    place: int
    address: str
    value: str
    text: str = ""
    time_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingStop:
    """A stop of a drive that stands: not confirmed yet, or demanded by a door until that releases it.

    who: who asked for it, or demands it. since_s: in seconds since 1970. confirmed: whether the drive has acknowledged
    it and does not run against it; otherwise it is being retried. demanded: nothing is started until it is released.
    """

    how: Stop
    who: str
    since_s: float
    confirmed: bool = False
    demanded: bool = False

    def __str__(self) -> str:
        said = f"stop ({self.how.value}) {'demanded' if self.demanded else 'asked for'} by {self.who}"
        return said if self.confirmed else f"{said}, not confirmed; retrying until the drive answers"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveState:
    """A drive as it was last seen.

    line: the plant's name of its line. reachability: what came of the last request: asking, answers or silent. status:
    the last one, None when there was none or the drive has fallen silent. fault: what it tripped with, empty without a
    fault. late: its line had no time to ask for its status, which may have changed since. error: why the last request
    failed, or was not made in time. answered_s: when it last answered, in seconds since 1970. lease: who commands it
    now. kept: the link-loss policy under which this server keeps it running, empty where it does not. statistics: what
    has happened with it on its line; goes on counting. policies: the link-loss policies that it can be started with.
    monitoring_only: its model has no orders, so that nothing can command it.
    fault_log: what it remembered of its faults when it was asked last, the newest first. standing_stop: the stop that
    is retried or demanded now, None without one. drift: how far it is set as approved, when it was compared last.
    """

    config: DriveConfig
    line: str
    reachability: Reachability = "asking"
    status: DriveStatus | None = None
    fault: str = ""
    late: bool = False
    error: str = ""
    answered_s: float | None = None
    lease: Lease | None = None
    kept: str = ""
    statistics: Statistics = field(default_factory=Statistics)
    policies: tuple[LinkLoss, ...] = ()
    monitoring_only: bool = False
    fault_log: tuple[RememberedFault, ...] = ()
    standing_stop: StandingStop | None = None
    drift: DriveDrift = NOT_COMPARED

    @property
    def name(self) -> str:
        """What the plant calls it."""
        return self.config.name

    @property
    def counters(self) -> Mapping[str, int]:
        """What has happened with it so far, by the names in `drivecomm.link.COUNTERS`."""
        return self.statistics.counters

    @property
    def reply_s(self) -> float:
        """The mean of its reply times."""
        return self.statistics.reply_times.mean_s


new_state = maker(DriveState)
"""Returns a DriveState, as its constructor does; doors ask for thousands in a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineState:
    """A line.

    port: what is opened. up: whether it is open. error: why not. polls: made so far. missed: left out so far, because
    the line had no time for them. late: it has no time to ask every drive for its status. late_statuses: statuses not
    asked for in time so far. other_master: why it counts as shared, empty if it does not.
    """

    name: str
    port: str
    up: bool = False
    error: str = ""
    polls: int = 0
    missed: int = 0
    late: bool = False
    late_statuses: int = 0
    other_master: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorState:
    """A door.

    up: whether it is open, and reaches its broker if it has one. clients: connections that are open; None for a door
    that nobody connects to. backlog_rows: rows of the history that it has not delivered yet, among them those of the
    last seconds, which may be under way; None for a door that delivers no history.
    """

    name: str
    up: bool
    clients: int | None = None
    backlog_rows: int | None = None


EventKind: TypeAlias = Literal[
    "fault", "fault over", "warning", "silent", "answers", "state", "command", "lease", "link loss", "line", "door",
    "alarm", "server",
]  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that a person wants to know later.

    number: counts up within one run of the server. time_s: in seconds since 1970. drive, line: what it is about, empty
    where it is about neither. who: the caller or the program's part that caused it, empty for the plant itself. alarm:
    the id of the alarm that it is about, as `acknowledge` takes it.
    """

    number: int
    time_s: float
    kind: EventKind
    text: str
    drive: str = ""
    line: str = ""
    who: str = ""
    alarm: str = ""
