"""The alarms of a server: they follow the changes of its plant, become events, and are passed to the delivery."""

from __future__ import annotations

import asyncio
import os
import time
from contextlib import suppress
from threading import Lock
from typing import TYPE_CHECKING, Protocol

from drivecomm.errors import FileFormatError, NotAllowedError, UsageError
from drivecomm.line import STATUS
from drivecomm.server import Role
from drivecomm.server.alarms.alarm import Treatment
from drivecomm.server.alarms.delivery import AlarmDelivery, UndeliveredAlarm
from drivecomm.server.alarms.kept_state import StoredAlarms, read_state, write_state
from drivecomm.server.alarms.messages import entry_of
from drivecomm.server.alarms.receivers import receivers_of
from drivecomm.server.alarms.states import Alarms

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from drivecomm.server import Caller, ChangeStream, CurrentValue, Event, EventKind, ServedPlant
    from drivecomm.server.alarms.alarm import Alarm, AlarmTransition, Treated
    from drivecomm.server.alarms.delivery import DeliveryTiming
    from drivecomm.server.alarms.rules import AlarmRule

_LOOK_S = 0.2
_SEEN_EVERY_S = 0.05
"""Minimum time between batches of changes; delays an alarm by this time at most."""
_DELIVERED = frozenset({"raised", "reminded", "over"})


class WriteEvent(Protocol):
    """The type of the function that records events; called from several threads."""

    def __call__(self, kind: EventKind, text: str, *, drive: str = "", who: str = "", alarm: str = "") -> None:
        """Record an event. alarm: the id of the alarm that it belongs to."""


class PlantAlarms:
    """The alarms of a plant, run in a separate thread like a door; other methods may be called from any thread.

    file: stores the standing alarms, so that they survive a restart. Raises UsageError for an invalid receiver in the
    plant file.
    """

    name = "alarms"

    def __init__(
        self,
        plant: ServedPlant,
        rules: Sequence[AlarmRule],
        *,
        file: Path,
        write_event: WriteEvent,
        pace: DeliveryTiming | None = None,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        self._plant = plant
        self._file = file
        self._write_event = write_event
        self._pace = pace
        self._environment = environment
        self._rules = rules
        self._deliver = {rule.name: rule.deliver for rule in rules}
        self._receivers = receivers_of(_entries(rules), environment)
        self._others = False
        state = self._read(self._receivers)
        self._lock = Lock()
        self._alarms = Alarms(
            rules,
            run=plant.session,
            stood=state.alarms,
            number=state.number,
            now_s=time.monotonic(),
            time_s=time.time(),
        )
        self._delivery = self._new_delivery()
        self._outbox = [*state.waiting]
        self._changed = bool(state.waiting)
        self._kept = True

    def standing(self) -> Sequence[Alarm]:
        """Return all alarms that are active or not acknowledged, in their order."""
        with self._lock:
            return self._alarms.standing()

    @property
    def rules(self) -> Sequence[AlarmRule]:
        """The alarm rules in force."""
        return self._rules

    def acknowledge(self, caller: Caller, alarm_id: str, comment: str = "") -> Alarm:
        """Acknowledge an alarm and return it; no more reminders of it are sent.

        Raises NotAllowedError for a caller who may only view, UsageError for an alarm that does not stand.
        """
        return self._treat(caller, alarm_id, "acknowledged", comment)

    def confirm(self, caller: Caller, alarm_id: str, comment: str = "") -> Alarm:
        """Record that an acknowledged alarm was dealt with, and return it; an unacknowledged one stays as it is.

        Raises the same errors as `acknowledge`.
        """
        return self._treat(caller, alarm_id, "confirmed", comment)

    def comment(self, caller: Caller, alarm_id: str, comment: str) -> Alarm:
        """Set the comment of an alarm, in place of an earlier one, and return the alarm.

        Raises as `acknowledge` does.
        """
        return self._treat(caller, alarm_id, "commented", comment)

    def _treat(self, caller: Caller, alarm_id: str, what: Treated, comment: str) -> Alarm:
        if caller.role < Role.OPERATE:
            raise NotAllowedError(f"{caller} may not acknowledge alarms; that needs the role operate")
        with self._lock:
            done = self._alarms.treat(
                alarm_id, Treatment(what=what, by=caller.name, time_s=time.time(), comment=comment)
            )
            if done is None:
                return next(each for each in self._alarms.standing() if each.id == alarm_id)
        self._tell([done], who=str(caller))
        return done.alarm

    def change_rules(self, rules: Sequence[AlarmRule]) -> None:
        """Replace the rules: standing alarms continue if their rule still exists, and are over otherwise.

        Raises UsageError for an invalid receiver in the plant file; then nothing changes.
        """
        receivers = receivers_of(_entries(rules), self._environment)
        with self._lock:
            self._rules = rules
            self._alarms = Alarms(
                rules,
                run=self._plant.session,
                stood=self._alarms.standing(),
                number=self._alarms.number,
                now_s=time.monotonic(),
                time_s=time.time(),
            )
            # Old entries stay, because receivers of an alarm that ends with its rule must get its end, too.
            self._deliver |= {rule.name: rule.deliver for rule in rules}
            self._receivers, self._others = receivers, True

    async def run(self, _: ServedPlant, opened: Callable[[], None]) -> None:
        """Watch the plant until cancelled; then retry undelivered alarms for 2 s, and keep the rest in the file.

        May be called again afterwards.
        """
        opened()
        self._delivery.start()
        changes = self._plant.changes(_SEEN_EVERY_S)
        try:
            self._see_all()
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._follow(changes))
                tasks.create_task(self._look())
        finally:
            changes.close()
            await asyncio.to_thread(self._close)

    async def _follow(self, changes: ChangeStream) -> None:
        lost = changes.lost
        async for values, events in changes:
            if changes.lost != lost:
                lost = changes.lost
                self._see_all()
            self._see(values, events)

    async def _look(self) -> None:
        while True:
            if self._others:
                await asyncio.to_thread(self._exchange)
                self._delivery.start()
                self._see_all()
            with self._lock:
                found = self._alarms.look(time.monotonic(), time.time())
            self._tell(found)
            if self._changed:
                await asyncio.to_thread(self._keep)
            await asyncio.sleep(_LOOK_S)

    def _see_all(self) -> None:
        with self._lock:
            now_s, time_s = time.monotonic(), time.time()
            found = [each for state in self._plant.drives() for each in self._alarms.drive_seen(state, now_s, time_s)]
            for value in self._plant.values():
                found += self._alarms.value_seen(value, now_s, time_s)
        self._tell(found)

    def _see(self, values: Iterable[CurrentValue], events: Iterable[Event]) -> None:
        drives = {event.drive for event in events}
        found: list[AlarmTransition] = []
        with self._lock:
            now_s, time_s = time.monotonic(), time.time()
            for value in values:
                if value.name == STATUS:
                    drives.add(value.drive)
                else:
                    found += self._alarms.value_seen(value, now_s, time_s)
            for drive in filter(self._alarms.watches, drives):
                # The drive may have just been removed from the plant file.
                with suppress(UsageError):
                    found += self._alarms.drive_seen(self._plant.drive(drive), now_s, time_s)
        self._tell(found)

    def _tell(self, found: Sequence[AlarmTransition], who: str = "") -> None:
        for each in found:
            self._write_event("alarm", each.text, drive=each.alarm.drive, who=who, alarm=each.alarm.id)
            if each.what in _DELIVERED:
                entry = entry_of(each)
                with self._lock:
                    self._outbox += (
                        UndeliveredAlarm(to=to, entry=entry) for to in self._deliver.get(each.alarm.rule, ())
                    )
            self._change()

    def _keep(self) -> None:
        """Write the state to the file, and only then pass new alarms to the delivery."""
        with self._lock:
            self._changed = False
            new, self._outbox = self._outbox, []
        self._write(new)
        self._delivery.put(new)

    def _write(self, new: Sequence[UndeliveredAlarm]) -> None:
        with self._lock:
            waiting = (*self._delivery.waiting(), *new)
            state = StoredAlarms(number=self._alarms.number, alarms=tuple(self._alarms.standing()), waiting=waiting)
        try:
            write_state(self._file, state)
        except FileFormatError as error:
            if self._kept:
                self._say(f"alarms would not survive a restart now: {error}")
            self._kept = False
        else:
            self._kept = True

    def _new_delivery(self) -> AlarmDelivery:
        return AlarmDelivery(
            self._receivers, plant=self._plant.name, say=self._say, changed=self._change, pace=self._pace
        )

    def _exchange(self) -> None:
        """Switch to the current receivers, which also get the undelivered alarms."""
        self._delivery.close()
        with self._lock:
            self._outbox = [*self._delivery.waiting(), *self._outbox]
            self._delivery, self._others = self._new_delivery(), False
        self._change()

    def _read(self, entries: Iterable[str]) -> StoredAlarms:
        try:
            return read_state(self._file, entries)
        except FileFormatError as error:
            # Start without the old state: alarms that are raised again are better than none.
            aside = self._file.with_name(f"{self._file.name}.damaged")
            with suppress(OSError):
                self._file.replace(aside)
            self._say(f"alarms before this start are unknown; their file was renamed to {aside.name}: {error}")
            return StoredAlarms()

    def _close(self) -> None:
        self._keep()
        self._exchange()
        self._write(self._outbox)

    def _say(self, text: str) -> None:
        self._write_event("alarm", text)

    def _change(self) -> None:
        self._changed = True


def _entries(rules: Iterable[AlarmRule]) -> list[str]:
    return list(dict.fromkeys(entry for rule in rules for entry in rule.deliver))
