"""The core of a server: the lines of a plant, the state of its drives, and the services behind all doors.

All of it runs in one event loop and never blocks; doors run in their own threads, see `drivecomm.server.plant_service`.
"""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from drivecomm.errors import DriveCommError, UsageError, in_one_line, suggestion
from drivecomm.line import STATUS, result_of
from drivecomm.protocol import DriveState as Motor, Stop
from drivecomm.server.drift_state import NOT_COMPARED
from drivecomm.server.kept_motors import KeptMotors
from drivecomm.server.leases import Leases
from drivecomm.server.merged_stops import MergedStops, StopJob, StopKey
from drivecomm.server.observations import RememberedFault
from drivecomm.server.repeats import AnswerCache
from drivecomm.server.rights import Rights
from drivecomm.server.served_line import ServedLine, is_same_drive
from drivecomm.server.standing_stops import StandingStops
from drivecomm.server.stop_demands import StopDemands
from drivecomm.server.table import NOT_ASKED, ValueTable
from drivecomm.server.writes import Writes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig, DriveStatus, Model, Reading
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandAnswer, CommandRequest
    from drivecomm.server.drift_state import DriveDrift
    from drivecomm.server.observations import CurrentValue, DriveSnapshot, Event, StandingStop
    from drivecomm.server.recorders import AuditTrail, HistoryRecorder

_log = logging.getLogger("drivecomm.server")

LOOK_S = 0.1
"""Period of the check for expired leases."""
GROW_OLD_S = 0.3
"""Period of the check for values that are too old."""


class Core:
    """A plant that is served, as an asynchronous context manager.

    plant: the plant to serve; `changed` replaces it. session: a random word of this run. users_file: name of the users
    file, for messages. audit, journal: recorders of commands, and of values and events. status_period_s: poll period of
    each drive's status. port_of: returns the port to open for a line, instead of its own port.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        session: str,
        audit: AuditTrail,
        journal: HistoryRecorder | None = None,
        users_file: str = "the users file",
        status_period_s: float = 1.0,
        port_of: Callable[[PlantLine], Any] | None = None,
    ) -> None:
        loop = asyncio.get_running_loop()
        self.plant = plant
        self.session = session
        self.started_s = time.time()
        self.table = ValueTable(loop.call_later)
        self.lines: dict[str, ServedLine] = {}
        self.leases = Leases()
        self.merged_stops = MergedStops()
        self.standing_stops = StandingStops(self.table, self._stop_again)
        self.stop_demands = StopDemands(self.table, self.standing_stops.send_soon)
        self.kept = KeptMotors(self.table, self.standing_stops, self.leases)
        self.audit, self.journal = audit, journal
        self.answers = AnswerCache()
        self.writes = Writes()
        self._users_file = users_file
        self.rights = Rights(plant.file, users_file)
        self._status_period_s = status_period_s
        self._port_of = port_of or _said_port
        self.ending = False
        self.changing: frozenset[str] = frozenset()
        """Drives that are being replaced by a new plant; commands to them are refused meanwhile."""
        self._unchanging = asyncio.Event()
        self._unchanging.set()
        self._reading_fault_logs: dict[str, asyncio.Task[None]] = {}
        self.fault_logs: dict[str, tuple[RememberedFault, ...]] = {}
        """Fault logs of the drives as last read, the newest entry first."""
        self.drift: dict[str, DriveDrift] = {}
        """Results of the latest comparisons of drives with their baselines."""
        self._looking: asyncio.Task[None] | None = None
        self._grow_old_at = 0.0

    async def __aenter__(self) -> Self:
        if self.journal is not None:
            self.table.listen(self._keep)
        for line in self.plant.lines:
            self._add(line)
        self._looking = asyncio.create_task(self._look(), name="leases")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._looking is not None:
            self._looking.cancel()
        await self.release_all()
        await asyncio.gather(*(line.close() for line in self.lines.values()), return_exceptions=True)
        await self.merged_stops.close()
        await asyncio.gather(*self._reading_fault_logs.values(), return_exceptions=True)

    def line(self, name: str) -> ServedLine:
        """Return a line by its name. Raises UsageError if it is unknown."""
        if name not in self.lines:
            raise UsageError(f"there is no line {name!r} in this plant; {suggestion(name, self.lines, 'it has')}")
        return self.lines[name]

    def drives(self) -> Sequence[DriveSnapshot]:
        """Return the states of all drives, in the order of the plant."""
        found = {each.name: each for line in list(self.lines.values()) for each in line.states()}
        return [self._completed(found[each.name]) for each in self.plant.drives if each.name in found]

    def drive(self, name: str) -> DriveSnapshot:
        """Return the state of one drive. Raises UsageError if it is unknown or not served yet."""
        config = self.plant.drive(name)
        found = self.line(config.line).state_of(config.name)
        if found is None:
            raise UsageError(f"{config.name} is not served yet; the plant file is being read again")
        return self._completed(found)

    def _completed(self, state: DriveSnapshot) -> DriveSnapshot:
        kept, lease = self.kept.policy(state.name), self.leases.holder_of(state.name, now=time.monotonic())
        fault_log = self.fault_logs.get(state.name, ())
        stop, drift = self.standing_stop(state.name), self.drift.get(state.name, NOT_COMPARED)
        if not (kept or lease or fault_log or stop or drift is not NOT_COMPARED):
            return state
        return replace(state, lease=lease, kept=kept, fault_log=fault_log, standing_stop=stop, drift=drift)

    def standing_stop(self, drive: str) -> StandingStop | None:
        """Return the stop of a drive that is being retried or demanded, or None."""
        return self.stop_demands.of(drive, self.standing_stops.of(drive))

    async def release_all(self) -> None:
        """Release every kept motor by its policy, retry unconfirmed stops a last time, and refuse new starts.

        Motors that keep running are named in an event.
        """
        began, self.ending = not self.ending, True
        if began:
            self._name_running_motors()
        await self.kept.release_all()
        await self.standing_stops.finish()

    async def _stop_again(self, drive: str, how: Stop) -> None:
        """Try once to stop a drive of the plant. Raises the error if the drive does not confirm the stop."""
        config = self.plant.drive(drive)
        line = self.line(config.line)
        await line.opened()
        whom = line.drive(drive)
        # If the line was not open when the stop was requested, its kind was not checked then.
        used = how if how in whom.capabilities.stops else Stop.RAMP

        async def send(job: StopJob) -> None:
            job.number = self.standing_stops.sent([drive], used)
            await whom.with_stop_notice(job.goes_out).stop(used)
            self.standing_stops.confirmed(drive)

        await result_of(self.merged_stops.job(StopKey(config.line, str(config), used), send).task)

    def _status_seen(self, drive: str, status: DriveStatus) -> None:
        self.stop_demands.seen(drive, running=status.running)
        self.standing_stops.seen(drive, running=status.running)

    def _name_running_motors(self) -> None:
        """Record an event for each running motor that this server does not stop, as with the policy hold."""
        for each in self.drives():
            runs = each.status is not None and each.status.state is Motor.RUNNING
            name = each.config.name
            if runs and name not in self.kept and self.standing_stops.of(name) is None:
                text = "keeps running without this server; stop it with drivecomm stop, or at the drive"
                self.table.record_event("warning", text, drive=name, line=each.config.line)

    async def _look(self) -> None:
        """Expire leases, release the motors kept under them, and mark old values as stale; runs until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                for lease in self.leases.expire(time.monotonic()):
                    self.kept.lease_expired(lease)
                self.kept.look()
                self._grow_old()
            except Exception:  # noqa: BLE001 - the server must not stop for this
                # This task must outlive every error, because leases depend on it.
                _log.exception("looking after leases")

    def _grow_old(self) -> None:
        """Mark overdue values as stale, and notify their lines of overdue statuses."""
        if (now := time.monotonic()) < self._grow_old_at:
            return
        self._grow_old_at = now + GROW_OLD_S
        late = [value.drive for value in self.table.grow_old() if value.name == STATUS]
        for line in self.lines.values():
            for drive in late:
                line.status_is_late(drive, NOT_ASKED, now)
            line.look(now)

    def remember(self, caller: Caller, command: CommandRequest, answer: CommandAnswer, asked_s: float) -> None:
        """Record a command in the history."""
        if self.journal is not None:
            self.journal.add_command(caller, command, answer, asked_s=asked_s, done_s=time.time())

    def _keep(self, values: Sequence[CurrentValue], events: Sequence[Event]) -> None:
        if self.journal is not None:
            self.journal.add_values(values)
            self.journal.add_events(events)

    async def changed(self, plant: Plant) -> Sequence[str]:
        """Replace the plant by another one; return the changes as texts.

        Lines with an unchanged port and settings stay open. Motors of unchanged drives are still kept.
        """
        before = self.plant
        old, new = {line.name: line for line in before.lines}, {line.name: line for line in plant.lines}
        closed = {name for name, known in old.items() if known != new.get(name)}
        gone = {each.name for each in before.drives if each.line in closed or each not in plant.drives}
        self.changing = frozenset(gone)
        self._unchanging.clear()
        try:
            # First, while the lines are open and still have the drives that were started.
            await self.kept.release_all(gone)
            self.plant = plant
            self.rights = Rights(plant.file, self._users_file)
            exchanging = (self._exchange(name, before, gone, new.get(name), anew=name in closed) for name in old)
            told = [text for text in await asyncio.gather(*exchanging) if text]
            for name, line in new.items():
                if name not in self.lines:
                    self._add(line)
                    if name not in old:
                        told.append(f"line {name} is new")
        finally:
            self.changing = frozenset()
            self._unchanging.set()
        for text in told:
            self.table.record_event("server", text)
        return told

    async def settled(self) -> None:
        """Wait until no drive is being replaced."""
        await self._unchanging.wait()

    async def _exchange(self, name: str, before: Plant, gone: set[str], line: PlantLine | None, *, anew: bool) -> str:
        """Adapt one line to the new plant; return the change as a text, "" for none. Raises nothing.

        Stops go to the old line until the new one exists: nothing is awaited between closing the old line and adding
        the new one.
        """
        served, gone_here = self.lines.get(name), {each.name for each in before.on_line(name)}.intersection(gone)
        try:
            if anew:
                if served is not None:
                    with suppress(Exception):
                        await served.close()
                    del self.lines[name]
                # Only now, because values of these drives arrived until the line was closed.
                self._forget(gone_here, before)
                if line is not None:
                    self._add(line)
                return f"line {name} {'is closed' if line is None else 'is opened anew'}"
            if served is not None and before.on_line(name) != self.plant.on_line(name):
                await served.pause()
                self._forget(gone_here, before)
                try:
                    served.set_drives(self._drives_of(name))
                finally:
                    served.start()
                return f"line {name} has other drives, or other values to poll"
        except Exception as error:  # noqa: BLE001 - one failing line must not hold up the others
            _log.exception("exchanging line %s", name)
            return f"line {name} could not be replaced: {in_one_line(error)}"
        return ""

    def _forget(self, gone: set[str], before: Plant) -> None:
        """Forget the values of replaced drives, and all other state of names that are gone or mean another drive."""
        there = {each.name: each for each in self.plant.drives}
        self.table.forget(gone.difference(there))
        self.table.forget(gone.intersection(there), why="the plant file was read again")
        for name in gone:
            if not is_same_drive(before.drive(name), there.get(name)):
                self.leases.forget(name)
                self.standing_stops.end(name, "the plant file was read again, and the drive has changed or is gone")
                self.fault_logs.pop(name, None)
                self.drift.pop(name, None)
                if (reading := self._reading_fault_logs.get(name)) is not None:
                    reading.cancel()

    def _add(self, line: PlantLine) -> None:
        try:
            served = ServedLine(
                line,
                self._drives_of(line.name),
                self.table,
                port=self._port_of(line),
                status_period_s=self._status_period_s,
                tripped=self._tripped,
                status_seen=self._status_seen,
            )
        except Exception as error:  # noqa: BLE001 - one failing line must not affect the others
            self.table.record_event("line", in_one_line(error), line=line.name)
            return
        self.lines[line.name] = served
        served.start()

    def _drives_of(self, line: str) -> Sequence[DriveConfig]:
        file = self.plant.file
        return [replace(each, read_only_reason=each.why_read_only(file)) for each in self.plant.on_line(line)]

    def _tripped(self, drive: str) -> None:
        """Start reading the fault log of a drive that has just tripped, if its model has one."""
        if drive not in self._reading_fault_logs:
            reading = asyncio.create_task(self._read_fault_log(drive), name=f"fault log of {drive}")
            self._reading_fault_logs[drive] = reading
            reading.add_done_callback(lambda _: self._reading_fault_logs.pop(drive))

    async def _read_fault_log(self, name: str) -> None:
        try:
            drive = self.line(self.plant.drive(name).line).drive(name)
            entries, model = [], drive.model
            for parameter in model.fault_log if model is not None else ():
                # Entries that this drive does not have are left out.
                with suppress(DriveCommError):
                    entries.append(_with_text(await drive.polled(parameter), model))
            if entries:
                time_s = time.time()
                self.fault_logs[name] = tuple(_remembered(place, each, time_s) for place, each in enumerate(entries, 1))
                if self.journal is not None:
                    self.journal.add_fault_log(name, entries, time_s=time_s)
        except Exception:  # noqa: BLE001 - the server must not stop for this
            _log.exception("fault log of %s", name)


def _with_text(entry: Reading, model: Model | None) -> Reading:
    """Return a fault log entry with the text of its fault number, if the drive's model has one."""
    if entry.text or model is None or isinstance(entry.value, str) or entry.value != int(entry.value):
        return entry
    return replace(entry, text=model.faults.get(int(entry.value), "" if entry.value else "no fault"))


def _remembered(place: int, reading: Reading, time_s: float) -> RememberedFault:
    return RememberedFault(
        place=place, address=reading.parameter, value=str(reading.value), text=reading.text, time_s=time_s
    )


def _said_port(line: PlantLine) -> str:
    if not line.reached_at:
        raise UsageError(f'line {line.name} has no port; write port = "/dev/ttyUSB0" there')
    return line.reached_at
