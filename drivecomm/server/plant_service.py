"""The served plant as doors see it, from their own threads: commands and other calls are passed to the core."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import DriveCommError, NotAllowedError, TooOftenError, UsageError
from drivecomm.line import result_of
from drivecomm.server.callers import LOCAL, Role
from drivecomm.server.commands import CommandExecutor
from drivecomm.server.door import CommandAnswer, CommandRequest
from drivecomm.server.line_examination import Crossing, examination
from drivecomm.server.rates import READ_RATE, Rates
from drivecomm.server.rights import MOTOR_VERBS, NEEDS
from drivecomm.server.stopping import stop_kind
from drivecomm.server.table import ChangeSubscription

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Collection, Coroutine, Mapping, Sequence

    from drivecomm.plant import Plant
    from drivecomm.server.alarms import Alarm, AlarmRule, PlantAlarms
    from drivecomm.server.callers import Caller
    from drivecomm.server.core import Core
    from drivecomm.server.door import Examination, KnownUsers, PlantHistory, Stopped
    from drivecomm.server.drift_state import DriveDrift
    from drivecomm.server.leases import Lease
    from drivecomm.server.observations import (
        CurrentValue,
        DoorSnapshot,
        DriveSnapshot,
        Event,
        LineSnapshot,
        StandingStop,
    )
    from drivecomm.server.rates import Rate
    from drivecomm.server.supervision import OpenDoor

T = TypeVar("T")

COMMANDING = frozenset(verb for verb, needs in NEEDS.items() if needs.commands)
READING = frozenset(NEEDS) - COMMANDING - {"stop", "wait"}
"""Verbs that take time on a line at each call; without `wait`, because waiting callers share a line by turns."""


class PlantForDoors:
    """The `ServedPlant` of a core that runs in this event loop. name: the name of the plant."""

    def __init__(
        self,
        core: Core,
        name: str,
        *,
        users: KnownUsers | None = None,
        history: PlantHistory | None = None,
        read_rate: Rate = READ_RATE,
    ) -> None:
        self.name, self.users, self.history = name, users, history
        self._core = core
        self._commands = CommandExecutor(core)
        self._rates = Rates(read_rate)
        self._loop = asyncio.get_running_loop()
        self._alarms: PlantAlarms | None = None
        self._doors: Sequence[OpenDoor] = ()

    def set_alarms(self, alarms: PlantAlarms) -> None:
        """Set the alarms of the plant; before this call it has none."""
        self._alarms = alarms

    def set_doors(self, doors: Sequence[OpenDoor]) -> None:
        """Set the doors that `doors` reports on; before this call it reports none."""
        self._doors = doors

    @property
    def session(self) -> str:
        """A random word of this run of the server."""
        return self._core.session

    @property
    def started_s(self) -> float:
        """The time at which the server was started, in seconds since 1970."""
        return self._core.started_s

    @property
    def plant(self) -> Plant:
        """The current plant as data."""
        return self._core.plant

    def drives(self) -> Sequence[DriveSnapshot]:
        """Return the states of all drives, in the order of the plant."""
        return self._core.drives()

    def drive(self, name: str) -> DriveSnapshot:
        """Return the state of one drive. Raises UsageError for a name that the plant does not have."""
        return self._core.drive(name)

    def answering(self) -> Collection[str]:
        """Return the names of the drives that answer."""
        return {name for line in list(self._core.lines.values()) for name in line.answering()}

    def standing_stops(self) -> Mapping[str, StandingStop]:
        """Return the stops that are being retried or demanded, by the names of their drives."""
        core = self._core
        names = {*core.standing_stops.drives, *core.stop_demands.drives}
        return {name: stop for name in names if (stop := core.standing_stop(name)) is not None}

    def drifts(self) -> Mapping[str, DriveDrift]:
        """Return the latest comparisons with the baselines, by drive name, without drives not yet compared."""
        return self._core.drift.copy()

    def values(self) -> Sequence[CurrentValue]:
        """Return all current values."""
        return self._core.table.values()

    def value(self, drive: str, name: str) -> CurrentValue | None:
        """Return the current value of one quantity, or None before the first one."""
        return self._core.table.value(drive, name)

    def lines(self) -> Sequence[LineSnapshot]:
        """Return the states of all lines."""
        return [line.state() for line in list(self._core.lines.values())]

    def doors(self) -> Sequence[DoorSnapshot]:
        """Return the states of all doors, each under a unique name."""
        journal = self._core.journal
        states = [door.state(None if journal is None else journal.last_row) for door in self._doors]
        before = Counter[str]()
        for place, state in enumerate(states):
            before[state.name] += 1
            if (number := before[state.name]) > 1:
                states[place] = replace(state, name=f"{state.name} ({number})")
        return states

    def events(self) -> Sequence[Event]:
        """Return the latest events, the oldest first."""
        return self._core.table.events()

    def changes(self, every_s: float = 0.0) -> ChangeSubscription:
        """Subscribe to changes from now on; call it in the event loop that reads them."""
        return ChangeSubscription(self._core.table, every_s)

    def leases(self) -> Sequence[Lease]:
        """Return the leases in force."""
        return self._core.leases.all(now=time.monotonic())

    async def command(self, caller: Caller, command: CommandRequest) -> CommandAnswer:
        """Carry out a command if its caller may; it continues even if the waiting caller is cancelled."""
        try:
            self._check_rate(caller, command)
        except TooOftenError as error:
            return CommandAnswer(id=command.id, outcome="refused", error=error)
        work = self._commands.carry_out(caller, command)
        # A wait ends with its caller.
        return await (self._lent(work) if command.verb == "wait" else self._handed(work))

    def refuse(self, caller: Caller, command: CommandRequest, why: str) -> None:
        """Record in the audit that a door refused a command."""
        self._later(self._refused, caller, command, why)

    def tell(self, text: str, *, drive: str = "", who: str = "") -> None:
        """Record a message of a door as an event."""
        self._later(partial(self._core.table.record_event, "door", text, drive=drive, who=who))

    async def stop_all(self, caller: Caller, how: str, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, or those of the named lines, in parallel: on each line by a broadcast, then each drive."""
        return await self._handed(self._commands.stop_all(caller, stop_kind({"how": how}), lines))

    def hold_stop(self, caller: Caller, drive: str, how: str) -> Callable[[], None]:
        """Demand that a drive stay stopped until the returned function is called."""
        kind = stop_kind({"how": how})
        held: list[Callable[[], None]] = []
        self._later(lambda: held.append(self._core.stop_demands.hold(drive, kind, str(caller))))

        def release() -> None:
            # Runs after the hold, because the core handles calls in their order.
            while held:
                held.pop()()

        return partial(self._later, release)

    async def take_lease(self, caller: Caller, drive: str, seconds: float) -> Lease:
        """Acquire the lease of a drive."""
        return await self._handed(self._take(caller, drive, seconds))

    async def renew_lease(self, caller: Caller, drive: str, key: str, seconds: float) -> Lease:
        """Reset the remaining time of a lease."""
        return await self._handed(self._renew(caller, drive, key, seconds))

    async def end_lease(self, caller: Caller, drive: str, key: str) -> None:
        """Release a lease."""
        await self._handed(self._end(caller, drive, key))

    def may(self, caller: Caller, drive: str) -> Sequence[str]:
        """Return the verbs that this caller may use on a drive; no motor commands if the drive is monitoring only."""
        config = self._core.plant.drive(drive)
        verbs = self._core.rights.verbs_for(caller, config)
        if self._core.line(config.line).is_monitoring_only(config.name):
            return [verb for verb in verbs if verb not in MOTOR_VERBS]
        return verbs

    def alarms(self) -> Sequence[Alarm]:
        """Return the alarms that are active or not acknowledged."""
        return [] if self._alarms is None else self._alarms.standing()

    def alarm_rules(self) -> Sequence[AlarmRule]:
        """Return the alarm rules of the plant file."""
        return [] if self._alarms is None else self._alarms.rules

    async def acknowledge(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Acknowledge an alarm and return it."""
        return self._watching.acknowledge(caller, alarm, comment)

    async def confirm_alarm(self, caller: Caller, alarm: str, comment: str = "") -> Alarm:
        """Record that an acknowledged alarm was dealt with, and return it."""
        return self._watching.confirm(caller, alarm, comment)

    async def comment_alarm(self, caller: Caller, alarm: str, comment: str) -> Alarm:
        """Set the comment of an alarm and return the alarm."""
        return self._watching.comment(caller, alarm, comment)

    @property
    def _watching(self) -> PlantAlarms:
        if self._alarms is None:
            raise UsageError("the plant file has no [[alarm]]")
        return self._alarms

    def kept_events(self, caller: Caller, drive: str) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the events of a motor that the server keeps running, until it is no longer kept."""
        _check(caller, Role.VIEW)
        return Crossing(lambda: self._core.kept.following(drive), self._loop).items()

    def examine(
        self, caller: Caller, line: str, what: Examination, choices: Mapping[str, Any]
    ) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the findings of a scan, the doctor, the trace or the statistics of a line."""
        _check(caller, Role.COMMISSION)
        return Crossing(lambda: examination(self._core, line, what, choices), self._loop).items()

    def _check_rate(self, caller: Caller, command: CommandRequest) -> None:
        """Raise TooOftenError if a caller from a network reads values of a line faster than the server allows.

        Programs on the same machine are not limited here: the turns of the line limit them.
        """
        if caller.door == LOCAL or command.verb not in READING:
            return
        line = next((each.line for each in self._core.plant.drives if each.name == command.drive), "")
        listed = command.arguments.get("parameters")
        cost = len(listed) if isinstance(listed, list | tuple) else 1
        wait_s = self._rates.wait_s((caller.name, line), time.monotonic(), max(1, cost))
        if wait_s > 0:
            raise TooOftenError(
                f"{caller.name} reads more values of line {line} than this server allows; wait {wait_s:.1f} s, take "
                "the values that it polls, or write read_rate = {...} in [server]",
                wait_s=wait_s,
            )

    def _refused(self, caller: Caller, command: CommandRequest, why: str) -> None:
        with suppress(DriveCommError):
            self._core.audit.refused(caller, command, why)

    async def _take(self, caller: Caller, drive: str, seconds: float) -> Lease:
        config = self._core.plant.drive(drive)
        # A caller who may arm a drive for one command may also acquire its lease.
        arms = caller.door == LOCAL and caller.role >= Role.COMMISSION
        if not arms and not COMMANDING & set(self._core.rights.verbs_for(caller, config)):
            # Raises the error that names the missing right.
            self._core.rights.check(caller, CommandRequest(drive=drive, verb="set_reference"), config)
        return self._core.leases.take(caller, config.name, seconds, now=time.monotonic(), time_s=time.time())

    async def _renew(self, caller: Caller, drive: str, key: str, seconds: float) -> Lease:
        return self._core.leases.renew(caller, drive, key, seconds, now=time.monotonic(), time_s=time.time())

    async def _end(self, caller: Caller, drive: str, key: str) -> None:
        lease = self._core.leases.end(caller, drive, key, now=time.monotonic())
        self._core.kept.given_back(lease)

    def _later(self, do: Callable[..., object], *content: object) -> None:
        """Call a function in the core's event loop without waiting for it; do nothing if that loop has ended."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(do, *content)

    async def _handed(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the core and wait for it. It runs to its end, even if the waiting caller is cancelled."""
        return await result_of(self._lent(work))

    def _lent(self, work: Coroutine[Any, Any, T]) -> asyncio.Future[T]:
        """Run a coroutine in the core; cancelling the returned future cancels the coroutine."""
        return asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, self._loop))


def _check(caller: Caller, role: Role) -> None:
    if caller.role < role:
        raise NotAllowedError(f"{caller.name} may not see this; it is for users with the role {role.name.lower()}")
