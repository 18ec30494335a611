"""Observations of a served plant, as immutable values: current values, drives, lines, doors and events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.line import FRESH
from drivecomm.link import Statistics
from drivecomm.protocol import frozen_factory
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
    """The latest value of one quantity of one drive.

    drive: its name in the plant. name: as the plant polls it, an address or a common name. reading: the last good one,
    None if none is recent enough; its time is that of the reply. quality: good, uncertain, stale or bad, at the time of
    storing. cause: why there is no value. time_s: when this state was found, in seconds since 1970. keeps_s: maximum
    age of a current value, in seconds. unreadable: by the plant file and the model, this drive has no such quantity.
    machine: the unit of the drive's machine, None without one.
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
        """The time at which the reply with the value arrived, or None without a value."""
        return None if self.reading is None else self.reading.time_s

    @property
    def remark(self) -> str:
        """The reason why there is no value, or a remark on the value."""
        return self.cause or ("" if self.reading is None else self.reading.remark)

    @property
    def at_machine(self) -> MachineValue | None:
        """The machine's speed for a frequency of a drive that has a machine; None for any other value."""
        return None if self.machine is None or self.reading is None else self.machine.beside(self.reading)

    def quality_at(self, time_s: float) -> ResultQuality:
        """Return the quality of the value at a time: a fresh value is stale once its age exceeds keeps_s.

        Readers need this because a server that hangs marks nothing as stale. The age counts in both directions, so a
        value does not stay fresh for long after the clock was set.
        """
        source_s = self.source_s
        if self.quality in FRESH and (source_s is None or abs(time_s - source_s) > self.keeps_s):
            return "stale"
        return self.quality


new_value = frozen_factory(CurrentValue)
"""Fast factory of CurrentValue objects; takes the arguments of the constructor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RememberedFault:
    """A fault in a drive's own log. place: 1 for the newest. value: its code. time_s: when the log was read."""

    place: int
    address: str
    value: str
    text: str = ""
    time_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingStop:
    """A standing stop of a drive: not confirmed yet, or demanded by a door until the door releases it.

    who: the caller that requested or demands it. since_s: in seconds since 1970. confirmed: whether the drive has
    acknowledged the stop and has not run since; otherwise it is being retried. demanded: the drive cannot be started
    until the stop is released.
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
class DriveSnapshot:
    """The state of a drive as last seen.

    line: the plant's name of its line. reachability: from the outcome of the last request: asking, answers or silent.
    status: the last one, None before the first or if the drive has fallen silent. fault: the fault with which it
    tripped, empty without one. late: its line had no time to poll its status, which may have changed since. error: why
    the last request failed, or was not made in time. answered_s: time of its last reply, in seconds since 1970. lease:
    the lease in force. kept: the link-loss policy under which this server keeps it running, empty if it does not.
    statistics: counters of its requests on the line; they continue to count. policies: the link-loss policies with
    which it can be started. monitoring_only: its model has no commands, so it cannot be commanded. fault_log: the
    drive's fault log as last read, the newest entry first. standing_stop: the stop that is being retried or demanded,
    None without one. drift: the result of the latest comparison with its baseline.
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
        """The name of the drive in the plant."""
        return self.config.name

    @property
    def counters(self) -> Mapping[str, int]:
        """The counters of the drive's requests, by the names in `drivecomm.link.COUNTERS`."""
        return self.statistics.counters

    @property
    def reply_s(self) -> float:
        """The mean of the drive's reply times in seconds."""
        return self.statistics.reply_times.mean_s


new_state = frozen_factory(DriveSnapshot)
"""Fast factory of DriveState objects, because doors need thousands a second; takes the constructor's arguments."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSnapshot:
    """The state of a line.

    port: the port that is opened. up: whether it is open. error: why it is not. polls: made so far. missed: polls
    skipped so far, because the line had no time for them. late: the line has no time to poll the status of every drive.
    late_statuses: statuses not polled in time so far. other_master: why the line counts as shared, empty if it does
    not.
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
class DoorSnapshot:
    """The state of a door.

    up: whether it is open, and reaches its broker if it has one. clients: connections that are open; None for a door
    that clients do not connect to. backlog_rows: rows of the history that it has not delivered yet, including rows of
    the last seconds, which may just be on their way; None for a door that delivers no history.
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
    """An event of the plant or the server that people may look up later.

    number: counts up within one run of the server. time_s: in seconds since 1970. drive, line: the subject of the
    event, empty if there is none. who: the caller or the program's part that caused it, empty for the plant itself.
    alarm: the id of the alarm that it belongs to, as `acknowledge` takes it.
    """

    number: int
    time_s: float
    kind: EventKind
    text: str
    drive: str = ""
    line: str = ""
    who: str = ""
    alarm: str = ""
