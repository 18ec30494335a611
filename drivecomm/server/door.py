"""What a door is written against: who asks, what is asked, what came of it, and the plant as a door sees it.

A door is made by the function that the entry point of its kind names (group `drivecomm.doors`), from its table in the
plant file, and runs in a thread and an event loop of its own. All that it is given may be called from there. When it
fails, the server says so, and starts it again after a while; nothing else notices.
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
    from drivecomm.server.history import PastCommand, PastEvent, PastValue, Summary
    from drivecomm.server.leases import Lease
    from drivecomm.server.observations import (
        CurrentValue,
        DoorState,
        DriveState,
        Event,
        LineState,
        StandingStop,
    )
    from drivecomm.tomlfile import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """Something to be done with a drive.

    drive: its name in the plant; PROTOCOL:ADDRESS with line for one that the plant does not have, which only callers of
    the local door may name, to ask and to stop it. verb: a method of `Drive`, such as read, write, start,
    set_reference. line: the plant's name of its line, empty for a drive of the plant. arguments: by their names. id:
    chosen by whoever asks; the same id again gets the first answer again. lease: the key of the lease under which it is
    asked; without one, a short lease is taken for the command alone where nobody else has one. arm: command a drive
    that the plant does not arm, which only callers of the local door may. options: what the caller says of the drive
    itself, such as attempts=1 or another model; only callers of the local door may. issued_s, valid_s, session: of
    commands that may have been under way for a while: when it was given, for how many seconds it counts, and the
    session of the plant that it was meant for.
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
"""done: it was carried out, and the drive has confirmed it. refused: nothing was sent. failed: the drive said no, or
what was only to be read was not read. open: it was sent, and whether the drive acted is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What came of a command. result: a Reading, a DriveStatus, or what the verb returns. error: why not done."""

    id: str
    outcome: Outcome
    result: Any = None
    error: DriveCommError | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """What came of stopping one of many. drive: its name, or PROTOCOL:* for a broadcast. how: the way that was used."""

    line: str
    drive: str
    how: Stop
    answer: Answer


class Changes(Protocol):
    """What changes from now on, for one event loop: batches of values and events, in their order.

    A reader who takes their time gets the latest of each value, and `lost` tells how many events they missed.
    """

    lost: int

    def __aiter__(self) -> AsyncIterator[tuple[Sequence[CurrentValue], Sequence[Event]]]:
        """Wait for the next batch."""

    def close(self) -> None:
        """Want no more."""


class LoggedIn(Protocol):
    """A token that counts for a while. until_s: in seconds since 1970."""

    @property
    def token(self) -> str:
        """What its owner shows."""

    @property
    def until_s(self) -> float:
        """Until when it counts."""


class KnownUsers(Protocol):
    """Who may come in by doors other than the local one; called from any thread."""

    def caller(self, token: str, door: str) -> Caller:
        """Return whose token this is. Raises NotAllowedError for nobody's."""

    async def log_in(self, name: str, password: str) -> LoggedIn:
        """Return a token for whoever knows the password. Raises NotAllowedError."""

    def renew(self, token: str) -> LoggedIn:
        """Let a login count for longer, for whoever is still there. Raises NotAllowedError for one that is over."""

    def log_out(self, token: str) -> None:
        """Let a login count no longer."""


class History(Protocol):
    """What the journal holds."""

    async def points(
        self, drive: str, name: str, from_s: float, to_s: float, points: int
    ) -> Sequence[tuple[float, Value | None, str]]:
        """Return a quantity's time, value and quality, thinned to about so many. Raises UsageError."""

    async def values(self, drive: str, name: str, from_s: float, to_s: float, limit: int) -> Sequence[PastValue]:
        """Return the first values of a quantity, as they were read, from one time to another one.

        Backwards where to_s is the earlier of both. Raises UsageError for what was never read.
        """

    async def summaries(self, drive: str, name: str, stretches: Sequence[tuple[float, float]]) -> Sequence[Summary]:
        """Return what a number comes to in stretches of time that follow each other, each from its begin to its end.

        Raises UsageError for what was never read.
        """

    async def events(self, *, drive: str, kind: str, from_s: float, to_s: float, limit: int) -> Sequence[Event]:
        """Return the latest events that fit, the oldest first; an empty drive or kind fits all."""

    def pieces(self, drive: str, name: str, from_s: float, to_s: float) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of a quantity as they were read, in pieces. Raises UsageError for what was never read."""

    async def happened_since(
        self, event_row: int, command_row: int, limit: int
    ) -> tuple[Sequence[PastEvent], Sequence[PastCommand]]:
        """Return the first events and commands after these rows, for who passes them on and must miss none."""

    async def last_rows(self) -> tuple[int, int]:
        """Return the rows of the latest event and of the latest command, 0 where there is none yet."""

    async def last_row(self) -> int:
        """Return the row of the latest value, 0 where there is none yet; rows count up as values come."""

    def since(self, row: int) -> AsyncGenerator[Sequence[PastValue], None]:
        """Yield the values of all drives after this row, in pieces, for who passes them on and must miss none.

        It ends with what is there now; who wants more asks again.
        """


Examination: TypeAlias = Literal["scan", "doctor", "trace", "statistics"]
"""What can be asked of a line as a whole."""


class ServedPlant(Protocol):
    """The plant as a door sees it; everything may be called from a door's own thread."""

    @property
    def name(self) -> str:
        """What the plant is called."""

    @property
    def session(self) -> str:
        """A random word of this run; a command that names another one was meant for an earlier run."""

    @property
    def started_s(self) -> float:
        """When the server was started, in seconds since 1970."""

    @property
    def plant(self) -> Plant:
        """The plant as data, as it is now."""

    def drives(self) -> Sequence[DriveState]:
        """Return all drives, in the order of the plant."""

    def drive(self, name: str) -> DriveState:
        """Return one drive. Raises UsageError for a name that the plant does not have."""

    def answering(self) -> Collection[str]:
        """Return the names of the drives that answer."""

    def standing_stops(self) -> Mapping[str, StandingStop]:
        """Return the stops that are retried or demanded now, by the names of their drives."""

    def drifts(self) -> Mapping[str, DriveDrift]:
        """Return how far drives are set as approved, by their names; without those that nobody has looked at yet."""

    def values(self) -> Sequence[CurrentValue]:
        """Return all current values, drive by drive."""

    def value(self, drive: str, name: str) -> CurrentValue | None:
        """Return the current value of one quantity as the plant polls it, None where there was none yet."""

    def lines(self) -> Sequence[LineState]:
        """Return all lines."""

    def doors(self) -> Sequence[DoorState]:
        """Return how all doors are, the local one first."""

    def events(self) -> Sequence[Event]:
        """Return the latest events, the oldest first."""

    def changes(self, every_s: float = 0.0) -> Changes:
        """Return what changes from now on; called within the event loop that reads it.

        every_s: batches are so far apart at least, for doors that are not in haste: each one costs the lines a moment.
        """

    def leases(self) -> Sequence[Lease]:
        """Return who commands what now."""

    async def command(self, caller: Caller, command: Command) -> Answer:
        """Carry out a command, if this caller may; never raises what is about the command, it is in the answer."""

    def refuse(self, caller: Caller, command: Command, why: str) -> None:
        """Have it written in the audit that a door did not let a command through."""

    def tell(self, text: str, *, drive: str = "", who: str = "") -> None:
        """Have an event written of what a door has to say; once for what lasts, and not for each message."""

    async def stop_all(self, caller: Caller, how: str, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, those of some lines only if named; all lines at once: by a broadcast first, then each."""

    def hold_stop(self, caller: Caller, drive: str, how: str) -> Callable[[], None]:
        """Demand that a drive stay stopped until the returned function is called; both take effect in their order.

        For a door whose protocol holds a stop as a level. The door sends the stop itself, by `command`. Until the
        demand is released, no door starts the drive, and the drive is stopped again if it is seen running.
        """

    async def take_lease(self, caller: Caller, drive: str, seconds: float) -> Lease:
        """Take the right to command a drive. Raises LeaseError while somebody else has it."""

    async def renew_lease(self, caller: Caller, drive: str, key: str, seconds: float) -> Lease:
        """Have it for longer. Raises LeaseError for one that is over, or not theirs."""

    async def end_lease(self, caller: Caller, drive: str, key: str) -> None:
        """Give it back. A motor that was started under it, and kept, is treated by its link-loss policy."""

    @property
    def users(self) -> KnownUsers | None:
        """Who may come in; None where the plant has no users, and only the local door has callers with a name."""

    @property
    def history(self) -> History | None:
        """What was, None where no journal is kept."""

    def may(self, caller: Caller, drive: str) -> Sequence[str]:
        """Return the verbs that this caller may use on a drive."""

    def alarms(self) -> Sequence[Alarm]:
        """Return the alarms that are on, or that nobody has acknowledged."""

    def alarm_rules(self) -> Sequence[AlarmRule]:
        """Return what is an alarm by the plant file."""

    async def acknowledge(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Acknowledge an alarm by its id, and return it: nobody is reminded of it any more.

        comment: what is said of it, which others are told. One that was acknowledged before stays as it is. Raises
        UsageError for one that is not there, NotAllowedError for a caller who may only look.
        """

    async def confirm_alarm(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Take note that an acknowledged alarm was dealt with, and return it; one that was not stays as it is.

        Raises as `acknowledge` does.
        """

    async def comment_alarm(self, caller: Caller, alarm: str, comment: str) -> Alarm:
        """Put a comment on an alarm, in place of an earlier one, and return it. Raises as `acknowledge` does."""

    def kept_events(self, caller: Caller, drive: str) -> AsyncIterator[Mapping[str, Any]]:
        """Tell what happens to the motor that the server keeps running, until it does so no more; in plain form."""

    def examine(
        self, caller: Caller, line: str, what: Examination, choices: Mapping[str, Any]
    ) -> AsyncIterator[Mapping[str, Any]]:
        """Tell what a scan, the doctor, the trace or the statistics of a line find, in plain form; for the local door.

        Raises UsageError, from the first item on, for choices that cannot be.
        """


class Door(Protocol):
    """A way into the plant."""

    @property
    def name(self) -> str:
        """How callers and events name it, such as "http 127.0.0.1:8080"."""

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled; raise what makes it impossible. opened: called when it can be used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorHealth:
    """How a door is, as it reports itself.

    up: whether it reaches its other side, such as a broker. clients: connections that are open; None for a door that
    nobody connects to. delivered_row: the row of the history up to which everything has been delivered; None for a
    door that delivers no history.
    """

    up: bool = True
    clients: int | None = None
    delivered_row: int | None = None


@runtime_checkable
class ReportsHealth(Protocol):
    """A door that knows more of its health than whether it is open."""

    def health(self) -> DoorHealth:
        """Return how the door is now; called from any thread, also before `run`, and must not wait."""


@runtime_checkable
class AddressesValues(Protocol):
    """A door whose clients find each value at an address, which `drivecomm tags export` lists."""

    def address_of(self, plant: str, drive: DriveConfig, name: str) -> str:
        """Return where a value is, empty if the door does not have it; asked before `run`, or without it.

        plant: what the plant is called. name: of the value, as the plant polls it, or "status".
        """


@runtime_checkable
class NamesDrives(Protocol):
    """A door whose table names drives of the plant; asked before anything is opened."""

    def check_plant(self, plant: Plant) -> None:
        """Raise FileFormatError, with its line, where the table names what the plant does not have."""


class MakeDoor(Protocol):
    """What the entry point of a kind of door names."""

    def __call__(self, table: Table) -> Door:
        """Return the door that a `[[door]]` of the plant file describes. Raises FileFormatError with its line.

        Where the file lists `levels`, the table has their names by level: `{"site": "Leeds", "line": ""}`.
        """
