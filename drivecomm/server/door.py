"""The contract of doors: callers, commands, answers, and the plant as a door sees it.

A door is made from its table in the plant file, by the function that the entry point of its kind names (group
`drivecomm.doors`). It runs in its own thread and event loop; everything that it receives may be called from there. If a
door fails, the server reports that and restarts the door after a while; other parts are not affected.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Collection, Mapping, Sequence

    from drivecomm.errors import DriveCommError
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig, Stop, Value
    from drivecomm.server.alarms import Alarm, AlarmRule
    from drivecomm.server.callers import Caller
    from drivecomm.server.drift_state import DriveDrift
    from drivecomm.server.history import PastCommand, PastEvent, PastValue, PeriodSummary
    from drivecomm.server.leases import Lease
    from drivecomm.server.observations import (
        CurrentValue,
        DoorSnapshot,
        DriveSnapshot,
        Event,
        LineSnapshot,
        StandingStop,
    )
    from drivecomm.tomlfile import TomlTable


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandRequest:
    """A command for one drive.

    drive: its name in the plant; PROTOCOL:ADDRESS with line for a drive that is not in the plant, which only callers of
    the local door may name, to read and to stop it. verb: a method of `Drive`, such as read, write, start,
    set_reference. line: the plant's name of its line, empty for a drive of the plant. arguments: by their names. id:
    chosen by the caller; a repeated id gets the first answer again. lease: the key of the lease under which the command
    is given; without one, a short lease is taken for this command alone if the drive is free. arm: command a drive that
    the plant does not arm, which only callers of the local door may. options: the caller's own settings of the drive,
    such as attempts=1 or another model; only callers of the local door may set them. issued_s, valid_s, session: for
    commands that may arrive late: the time of issue in seconds since 1970, the seconds for which the command is valid,
    and the session of the server that it was meant for.
    """

    drive: str
    verb: str
    line: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict, hash=False)
    id: str = ""
    lease: str = ""
    arm: bool = False
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    issued_s: float | None = None
    valid_s: float = 2.0
    session: str = ""


Outcome: TypeAlias = Literal["done", "refused", "failed", "open"]
"""The outcome of a command.

done: it was carried out, and the drive has confirmed it. refused: nothing was sent. failed: the drive refused, or a
value could not be read. open: it was sent, and whether the drive acted is not known.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswer:
    """The outcome of a command.

    result: a Reading, a DriveStatus, or another result of the verb. error: the reason for a failure, None if done.
    """

    id: str
    outcome: Outcome
    result: Any = None
    error: DriveCommError | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """The outcome of stopping one of several drives.

    drive: its name, or PROTOCOL:* for a broadcast. how: the kind of stop that was used.
    """

    line: str
    drive: str
    how: Stop
    answer: CommandAnswer


class ChangeStream(Protocol):
    """A subscription to changes, for one event loop: batches of values and events, in their order.

    A slow reader gets only the latest of each value, and `lost` counts the events that it missed.
    """

    lost: int

    def __aiter__(self) -> AsyncIterator[tuple[Sequence[CurrentValue], Sequence[Event]]]:
        """Return the iterator over the batches; it waits for each next batch."""

    def close(self) -> None:
        """Cancel the subscription."""


class LoginToken(Protocol):
    """A token that is valid for a while. until_s: in seconds since 1970."""

    @property
    def token(self) -> str:
        """The token that its owner sends with each request."""

    @property
    def until_s(self) -> float:
        """The time at which the token expires."""


class KnownUsers(Protocol):
    """Users that may use doors other than the local one; called from any thread."""

    def caller(self, token: str, door: str) -> Caller:
        """Return the owner of a token. Raises NotAllowedError if the token is unknown."""

    async def log_in(self, name: str, password: str) -> LoginToken:
        """Return a token for a user with the right password. Raises NotAllowedError."""

    def renew(self, token: str) -> LoginToken:
        """Extend a login of a user who is still active. Raises NotAllowedError if it has expired."""

    def log_out(self, token: str) -> None:
        """End a login; its token is invalid from now on."""


class PlantHistory(Protocol):
    """The stored history of a plant."""

    async def points(
        self, drive: str, name: str, from_s: float, to_s: float, points: int
    ) -> Sequence[tuple[float, Value | None, str]]:
        """Return times, values and qualities of a quantity, thinned to about `points` entries. Raises UsageError."""

    async def values(self, drive: str, name: str, from_s: float, to_s: float, limit: int) -> Sequence[PastValue]:
        """Return the first `limit` values of a quantity, as they were read, between two times.

        The order is backwards if to_s is before from_s. Raises UsageError for a quantity that was never read.
        """

    async def summaries(
        self, drive: str, name: str, stretches: Sequence[tuple[float, float]]
    ) -> Sequence[PeriodSummary]:
        """Return the summaries of a numeric quantity over consecutive periods, each given as (begin, end).

        Raises UsageError for a quantity that was never read.
        """

    async def events(self, *, drive: str, kind: str, from_s: float, to_s: float, limit: int) -> Sequence[Event]:
        """Return the latest matching events, the oldest first; an empty drive or kind matches all."""

    def pieces(self, drive: str, name: str, from_s: float, to_s: float) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of a quantity as they were read, in batches.

        Raises UsageError for a quantity that was never read.
        """

    async def events_and_commands_since(
        self, event_row: int, command_row: int, limit: int
    ) -> tuple[Sequence[PastEvent], Sequence[PastCommand]]:
        """Return the first events and commands after these rows, for a reader that forwards them without gaps."""

    async def last_rows(self) -> tuple[int, int]:
        """Return the rows of the latest event and of the latest command, 0 if there is none yet."""

    async def last_row(self) -> int:
        """Return the row of the latest value, 0 if there is none yet; row numbers increase as values arrive."""

    def since(self, row: int) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of all drives after this row, in batches, for a reader that forwards them without gaps.

        Ends with the latest value at the time; call it again for later ones.
        """


Examination: TypeAlias = Literal["scan", "doctor", "trace", "statistics"]
"""The ways to examine a whole line."""


class ServedPlant(Protocol):
    """The plant as a door sees it; everything may be called from a door's own thread."""

    @property
    def name(self) -> str:
        """The name of the plant."""

    @property
    def session(self) -> str:
        """A random word of this run; a command that names another one was meant for an earlier run."""

    @property
    def started_s(self) -> float:
        """The time at which the server was started, in seconds since 1970."""

    @property
    def plant(self) -> Plant:
        """The current plant as data."""

    def drives(self) -> Sequence[DriveSnapshot]:
        """Return the states of all drives, in the order of the plant."""

    def drive(self, name: str) -> DriveSnapshot:
        """Return the state of one drive. Raises UsageError for a name that the plant does not have."""

    def answering(self) -> Collection[str]:
        """Return the names of the drives that answer."""

    def standing_stops(self) -> Mapping[str, StandingStop]:
        """Return the stops that are being retried or demanded, by the names of their drives."""

    def drifts(self) -> Mapping[str, DriveDrift]:
        """Return the latest comparisons with the baselines, by drive name, without drives not yet compared."""

    def values(self) -> Sequence[CurrentValue]:
        """Return all current values, drive by drive."""

    def value(self, drive: str, name: str) -> CurrentValue | None:
        """Return the current value of one quantity that the plant polls, or None before the first one."""

    def lines(self) -> Sequence[LineSnapshot]:
        """Return the states of all lines."""

    def doors(self) -> Sequence[DoorSnapshot]:
        """Return the states of all doors, the local one first."""

    def events(self) -> Sequence[Event]:
        """Return the latest events, the oldest first."""

    def changes(self, every_s: float = 0.0) -> ChangeStream:
        """Subscribe to changes from now on; call it in the event loop that reads them.

        every_s: minimum time between batches, for doors that can wait: each batch takes a moment from the lines.
        """

    def leases(self) -> Sequence[Lease]:
        """Return the leases in force."""

    async def command(self, caller: Caller, command: CommandRequest) -> CommandAnswer:
        """Carry out a command if its caller may; errors of the command are returned in the answer, not raised."""

    def refuse(self, caller: Caller, command: CommandRequest, why: str) -> None:
        """Record in the audit that a door refused a command."""

    def tell(self, text: str, *, drive: str = "", who: str = "") -> None:
        """Record a message of a door as an event; for a lasting condition once, not for each message."""

    async def stop_all(self, caller: Caller, how: str, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, or those of the named lines, in parallel: on each line by a broadcast, then each drive."""

    def hold_stop(self, caller: Caller, drive: str, how: str) -> Callable[[], None]:
        """Demand that a drive stay stopped until the returned function is called; calls take effect in their order.

        For a door whose protocol holds a stop as a level. The door sends the stop itself, by `command`. Until the
        demand is released, no door starts the drive, and the drive is stopped again if it is seen running.
        """

    async def take_lease(self, caller: Caller, drive: str, seconds: float) -> Lease:
        """Acquire the lease of a drive. Raises LeaseError while another caller holds it."""

    async def renew_lease(self, caller: Caller, drive: str, key: str, seconds: float) -> Lease:
        """Reset the remaining time of a lease. Raises LeaseError if it has expired or belongs to another caller."""

    async def end_lease(self, caller: Caller, drive: str, key: str) -> None:
        """Release a lease. A kept motor that was started under it is released by its link-loss policy."""

    @property
    def users(self) -> KnownUsers | None:
        """The users of the plant; None if it has none, so that only callers of the local door have a name."""

    @property
    def history(self) -> PlantHistory | None:
        """The history of the plant, or None without a journal."""

    def may(self, caller: Caller, drive: str) -> Sequence[str]:
        """Return the verbs that this caller may use on a drive."""

    def alarms(self) -> Sequence[Alarm]:
        """Return the alarms that are active or not acknowledged."""

    def alarm_rules(self) -> Sequence[AlarmRule]:
        """Return the alarm rules of the plant file."""

    async def acknowledge(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Acknowledge an alarm by its id and return it; no more reminders of it are sent.

        comment: a remark that is shown to other users. An alarm that was acknowledged before stays as it is. Raises
        UsageError for an unknown alarm, NotAllowedError for a caller who may only view.
        """

    async def confirm_alarm(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Record that an acknowledged alarm was dealt with, and return it; an unacknowledged one stays as it is.

        Raises the same errors as `acknowledge`.
        """

    async def comment_alarm(self, caller: Caller, alarm: str, comment: str) -> Alarm:
        """Set the comment of an alarm, in place of an earlier one, and return the alarm.

        Raises as `acknowledge` does.
        """

    def kept_events(self, caller: Caller, drive: str) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the events of a motor that the server keeps running, in plain form, until it is no longer kept."""

    def examine(
        self, caller: Caller, line: str, what: Examination, choices: Mapping[str, Any]
    ) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the findings of a scan, the doctor, the trace or the statistics of a line, in plain form.

        Only for callers of the local door. Raises UsageError for invalid choices when the first item is requested.
        """


class Door(Protocol):
    """A way into the plant for clients, such as HTTP or MQTT."""

    @property
    def name(self) -> str:
        """The name of the door for callers and events, such as "http 127.0.0.1:8080"."""

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled; raise the error that makes it impossible. opened: called when clients can connect."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorHealth:
    """The health of a door, as the door reports it.

    up: whether the door reaches its other side, such as a broker. clients: connections that are open; None for a door
    that clients do not connect to. delivered_row: the row of the history up to which everything has been delivered;
    None for a door that delivers no history.
    """

    up: bool = True
    clients: int | None = None
    delivered_row: int | None = None


@runtime_checkable
class ReportsHealth(Protocol):
    """A door that reports its own health, in more detail than whether it is open."""

    def health(self) -> DoorHealth:
        """Return the current health; called from any thread, also before `run`, and must not wait."""


@runtime_checkable
class AddressesValues(Protocol):
    """A door whose clients find each value at an address, which `drivecomm tags export` lists."""

    def address_of(self, plant: str, drive: DriveConfig, name: str) -> str:
        """Return the address of a value, empty if the door does not have it; called before `run`, or without it.

        plant: the name of the plant. name: name of the value, as the plant polls it, or "status".
        """


@runtime_checkable
class NamesDrives(Protocol):
    """A door whose table names drives of the plant; checked before anything is opened."""

    def check_plant(self, plant: Plant) -> None:
        """Raise FileFormatError, with its line, if the table names something that the plant does not have."""


class MakeDoor(Protocol):
    """The factory function that the entry point of a kind of door names."""

    def __call__(self, table: TomlTable) -> Door:
        """Return the door that a `[[door]]` of the plant file describes. Raises FileFormatError with its line.

        If the file lists `levels`, the table has their names by level: `{"site": "Leeds", "line": ""}`.
        """
