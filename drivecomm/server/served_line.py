"""One line of a served plant: its bus, its polls, and the states of its drives."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.bus import broadcasts_of, open_bus_async
from drivecomm.errors import (
    DriveCommError,
    LinkError,
    PortError,
    UsageError,
    in_one_line,
)
from drivecomm.line import STATUS, PollItem, items_of, poll_async
from drivecomm.link import REOPEN_FIRST_S, REOPEN_LONGEST_S, Backoff, CommandHistory, Statistics
from drivecomm.plant.watching import DriveView, OpenLine, TrackedDrive, WatchedLine, changes, has_answered
from drivecomm.server.observations import CurrentValue, DriveSnapshot, LineSnapshot, new_state, new_value
from drivecomm.server.spells import Spell
from drivecomm.server.start_policies import policies_to_start_with, wrong_policy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import AsyncBus, AsyncDrive
    from drivecomm.line import PollResult
    from drivecomm.plant import PlantLine
    from drivecomm.protocol import DriveConfig, DriveStatus, LinkLoss
    from drivecomm.server.observations import EventKind
    from drivecomm.server.table import ValueTable

_KINDS: Mapping[str, EventKind] = {"fault": "fault", "silent": "silent", "warning": "warning", "change": "state"}

LATE_OVER_S = 30.0
"""Seconds without a late status or a missed poll, which come and go by the second, until a line keeps up again."""
MISSING_S = 10.0
"""Seconds of missed polls, more than a retry takes, until a line counts as too full, or its drives as silent."""

_log = logging.getLogger("drivecomm.server")


class ServedLine:
    """One line: opened repeatedly until its port opens, and polled while it is open. Polling errors are never raised.

    port: the port to open, by name or by a function. drives: the drives that the plant has on this line. tripped:
    called with the name of a drive that has just tripped. status_seen: called with each status that a drive has
    answered.
    """

    def __init__(
        self,
        line: PlantLine,
        drives: Sequence[DriveConfig],
        table: ValueTable,
        *,
        port: Any,
        status_period_s: float,
        tripped: Callable[[str], None],
        status_seen: Callable[[str, DriveStatus], None],
    ) -> None:
        self.line = line
        self.bus: AsyncBus = open_bus_async(port, **line.opening)
        self.order = CommandHistory()
        """Commands that wait in this server and that a stop cancels; the bus has its own list of those it has taken."""
        self._port_name = port if isinstance(port, str) else line.reached_at
        self._table = table
        self._status_period_s = status_period_s
        self._tripped, self._status_seen = tripped, status_seen
        self._open: OpenLine | None = None
        self._configs: dict[str, DriveConfig] = {}
        self._seen: dict[str, TrackedDrive] = {}
        self._unusable: dict[str, UsageError] = {}
        self._policies: dict[str, tuple[LinkLoss, ...]] = {}
        self._monitoring_only: dict[str, bool] = {}
        self._polls = self._missed = self._late_statuses = 0
        self._late = Spell(begins_after_s=0.0, quiet_s=LATE_OVER_S)
        self._missing = Spell(begins_after_s=MISSING_S, quiet_s=LATE_OVER_S)
        self._up, self._error, self._other_master = False, "", ""
        self._silent_with_line: set[str] = set()
        """Drives that fell silent with their line; their own silence is not reported yet."""
        self._tried = asyncio.Event()
        self._never_open: DriveCommError | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self.set_drives(drives)

    @property
    def drives(self) -> Sequence[DriveConfig]:
        """The drives that the plant has on this line."""
        return tuple(self._configs.values())

    def set_drives(self, drives: Sequence[DriveConfig]) -> None:
        """Replace the drives of this line; keep what is known about those that remain."""
        # A protocol without a broadcast stop is left out here: its drives are stopped one by one.
        self.everybody = tuple(each for _, each in broadcasts_of(self.bus, drives, lambda *_: None))
        seen: dict[str, TrackedDrive] = {}
        unusable: dict[str, UsageError] = {}
        for config in drives:
            try:
                drive = config.build(self.bus.drive)
            except Exception as error:  # noqa: BLE001 - a broken package must not affect other drives
                unusable[config.name] = (
                    error if isinstance(error, UsageError) else UsageError(f"{config.name} cannot be made: {error!r}")
                )
                wrong = f"cannot be served: {in_one_line(unusable[config.name])}"
                self._table.record_event("line", wrong, drive=config.name, line=self.line.name)
                continue
            if self._open is None:
                self._open = OpenLine(WatchedLine(name=self.line.name, port="", drives=tuple(drives)), self.bus)
            view = DriveView(drive=config, line=self.line.name)
            if (before := self._seen.get(config.name)) is not None and is_same_drive(before.view.drive, config):
                view = replace(before.view, drive=config)
            only_read = drive.capabilities.monitoring_only
            self._policies[config.name] = () if only_read else policies_to_start_with(drive.model)
            self._monitoring_only[config.name] = only_read
            seen[config.name] = TrackedDrive(self._open, drive, view)
            if wrong := wrong_policy(config, drive.model):
                self._table.record_event("link loss", wrong, drive=config.name, line=self.line.name)
        # Assigned in one statement, because doors read them from their own threads.
        self._configs, self._seen, self._unusable = {each.name: each for each in drives}, seen, unusable

    def drive(self, name: str) -> AsyncDrive:
        """Return a drive of the plant.

        Raises UsageError if the plant's data are invalid, or if it is not on this line.
        """
        if (error := self._unusable.get(name)) is not None:
            raise error.with_traceback(None)
        if (seen := self._seen.get(name)) is None:
            raise UsageError(f"{name} is no longer on line {self.line.name}")
        return seen.drive

    def state(self) -> LineSnapshot:
        """Return the state of the line."""
        return LineSnapshot(
            name=self.line.name,
            port=self._port_name,
            up=self._up,
            error=self._error,
            polls=self._polls,
            missed=self._missed,
            late=self._late.is_on,
            late_statuses=self._late_statuses,
            other_master=self._other_master,
        )

    def answering(self) -> Iterator[str]:
        """Yield the names of the drives that answered the latest request to them."""
        return (name for name, seen in self._seen.items() if seen.view.reachability == "answers")

    def is_monitoring_only(self, drive: str) -> bool:
        """Return whether the model of a drive has no commands; False for a drive that could not be made."""
        return self._monitoring_only.get(drive, False)

    def states(self) -> Sequence[DriveSnapshot]:
        """Return the states of the drives on this line."""
        counted = self.bus.statistics
        return [self._state(config, counted) for config in self._configs.values()]

    def state_of(self, drive: str) -> DriveSnapshot | None:
        """Return the state of a drive, or None if it is not on this line."""
        config = self._configs.get(drive)
        return None if config is None else self._state(config, self.bus.statistics)

    def _state(self, config: DriveConfig, counted: Mapping[str, Statistics]) -> DriveSnapshot:
        seen, line = self._seen.get(config.name), self.line.name
        if seen is None:
            error = self._unusable.get(config.name)
            text = "" if error is None else in_one_line(error)
            return DriveSnapshot(config=config, line=line, reachability="silent", error=text)
        view = seen.view
        return new_state(
            config=view.drive,
            line=line,
            reachability=view.reachability,
            status=view.status,
            fault=view.fault,
            error=view.error,
            late=view.late,
            answered_s=seen.answered_s,
            statistics=counted.get(seen.drive.name) or Statistics(),
            policies=self._policies[config.name],
            monitoring_only=self._monitoring_only[config.name],
        )

    def status_is_late(self, drive: str, why: str, now_s: float) -> None:
        """Record that this line had no time to poll the status of a drive; its last status remains."""
        seen = self._seen.get(drive)
        if seen is None or seen.view.reachability != "answers":
            return
        self._late_statuses += 1
        self._update(seen, replace(seen.view, late=True, error=why))
        if self._late.seen(now_s):
            text = f"is late: it had no time to poll the status of {drive}, and other drives may be affected"
            self._table.record_event(
                "line", f"{text}; drivecomm forecast shows the load of the line", line=self.line.name
            )

    def look(self, now_s: float) -> None:
        """Report lateness and missed polls that have ended. now_s: seconds of a monotonic clock."""
        if self._late.ends(now_s):
            spell = f"{self._late.incidents} late within {self._late.lasted_s:.0f} s"
            self._table.record_event("line", f"polls every status in time again ({spell})", line=self.line.name)
        if self._missing.ends(now_s):
            spell = f"{self._missing.incidents} missed within {self._missing.lasted_s:.0f} s"
            self._table.record_event("line", f"keeps up with its polls again ({spell})", line=self.line.name)

    def _polls_missed(self, number: int) -> None:
        self._missed += number
        if self._missing.seen(time.monotonic(), number):
            count, seconds = self._missing.incidents, self._missing.lasted_s
            text = f"misses polls: it had no time for {count} of them within {seconds:.0f} s"
            self._table.record_event(
                "line", f"{text}; drivecomm forecast shows the load of the line", line=self.line.name
            )

    async def opened(self) -> None:
        """Wait for the first attempt to open the line.

        Raises the error of the latest attempt if the line is not open.
        """
        await self._tried.wait()
        if self._never_open is not None:
            raise self._never_open.with_traceback(None)

    def start(self) -> None:
        """Start opening the port and polling."""
        self._tasks = [asyncio.create_task(self._serve(), name=f"line {self.line.name}")]

    async def pause(self) -> None:
        """Stop polling until `start` is called again."""
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def close(self) -> None:
        """Stop polling and close the port."""
        await self.pause()
        try:
            # Stops that arrive meanwhile still reach the old line.
            await self.bus.close()
        finally:
            self._never_open = UsageError(f"line {self.line.name} is closed")
            self._tried.set()

    async def _serve(self) -> None:
        waiting, loop = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S), asyncio.get_running_loop()
        began_s = loop.time()
        while True:
            try:
                await self._open_port()
                began_s = loop.time()
                if not (items := self._plan()):
                    return
                async for result in poll_async(items):
                    self._take(result)
            except Exception as error:  # noqa: BLE001 - polling restarts after any error
                _log.exception("line %s is polled again", self.line.name)
                if loop.time() - began_s > REOPEN_LONGEST_S:
                    # Polling worked for a while, so this failure begins a new series of failures.
                    waiting = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S)
                self._lost(f"polling has failed: {in_one_line(error)}")
                waiting.failed(loop.time())
                await asyncio.sleep(waiting.over_at - loop.time())

    async def _open_port(self) -> None:
        waiting, loop = Backoff(REOPEN_FIRST_S, REOPEN_LONGEST_S), asyncio.get_running_loop()
        while True:
            try:
                await self.bus.__aenter__()
            except Exception as error:  # noqa: BLE001 - any failure to open is retried
                self._never_open = error if isinstance(error, DriveCommError) else PortError(in_one_line(error))
                self._tried.set()
                self._silent_with_line.update(self._seen)
                self._lost(in_one_line(error))
                waiting.failed(loop.time())
                await asyncio.sleep(max(0.05, waiting.over_at - loop.time()))
            else:
                self._never_open = None
                self._tried.set()
                self._is_up(True)
                return

    def _lost(self, why: str) -> None:
        """Record that polling has stopped for now, so that all values of the line are bad."""
        self._is_up(False, why)
        self._late.forget()
        self._missing.forget()
        for seen in self._seen.values():
            self._update(seen, seen.view.silent(why))
        for value in self._table.values():
            if value.drive in self._seen and value.quality != "bad":
                self._table.put_value(replace(value, reading=None, quality="bad", cause=why, time_s=time.time()))

    def _plan(self) -> list[PollItem[TrackedDrive]]:
        items = []
        for seen in self._seen.values():
            name = seen.view.name
            items.append(PollItem(drive=seen, parameter=STATUS, period_s=self._status_period_s, priority=1, name=name))
            polled = items_of(seen.view.drive.poll, seen, name)
            items += [each for each in polled if self._readable(seen, each.parameter, each.options)]
        return items

    def _readable(self, seen: TrackedDrive, parameter: str, options: Mapping[str, Any]) -> bool:
        """Return whether a parameter can be read at all; if not, store a bad value for it."""
        try:
            seen.check_read(parameter, **options)
        except UsageError as error:
            self._table.put_value(
                CurrentValue(
                    drive=seen.view.name,
                    name=parameter,
                    reading=None,
                    quality="bad",
                    cause=in_one_line(error),
                    time_s=time.time(),
                    unreadable=True,
                )
            )
            return False
        return True

    def _take(self, result: PollResult) -> None:
        seen = self._seen.get(result.drive)
        if seen is None:
            return
        self._polls += 1
        if result.missed:
            self._polls_missed(result.missed)
        self._table.put_value(
            new_value(
                drive=result.drive,
                name=result.parameter,
                reading=result.reading,
                quality=result.quality,
                cause=result.cause,
                time_s=result.time_s,
                keeps_s=result.item.keeps_s,
                machine=seen.view.drive.machine,
            )
        )
        if (why := self.bus.other_master) != self._other_master:
            self._other_master = why
            self._table.record_event("line", why or "no other master was heard for a minute", line=self.line.name)
        view = seen.view_after(result, result.cause)
        if has_answered(result.error):
            self._answered(seen, result)
        elif view is not seen.view and (seen.view.reachability != "silent" or seen.view.error != result.cause):
            self._fell_silent(result)
        if view is not seen.view:
            self._update(seen, view)

    def _answered(self, seen: TrackedDrive, result: PollResult) -> None:
        self._is_up(True)
        self._silent_with_line.discard(result.drive)
        seen.answered_s = result.time_s
        if result.parameter == STATUS and result.error is None and seen.status is not None:
            self._status_seen(seen.view.name, seen.status)

    def _fell_silent(self, result: PollResult) -> None:
        """Report a silence that is new or has a new cause: of the line, or of this drive alone."""
        lost = isinstance(result.error, LinkError)
        self._is_up(not lost, result.cause)
        if lost:
            self._silent_with_line.add(result.drive)
        elif result.drive in self._silent_with_line:
            self._silent_with_line.discard(result.drive)
            self._table.record_event("silent", result.cause, drive=result.drive, line=self.line.name)

    def _update(self, seen: TrackedDrive, view: DriveView) -> None:
        before, seen.view = seen.view, view
        for change in changes(before, view, 0.0):
            if change.kind == "fault":
                self._tripped(view.name)
            kind = _KINDS.get(change.kind, "state")
            if change.text == "answers again":
                kind = "answers"
            elif change.text == "the fault is gone":
                kind = "fault over"
            text = change.text.removeprefix("fault: ")
            self._table.record_event(kind, text, drive=view.name, line=self.line.name)

    def _is_up(self, up: bool, error: str = "") -> None:
        if up and not self._up and self._error:
            self._table.record_event("line", "works again", line=self.line.name)
        elif not up and (self._up or not self._error):
            self._table.record_event("line", error, line=self.line.name)
        self._up, self._error = up, error


def is_same_drive(before: DriveConfig, now: DriveConfig | None) -> bool:
    """Return whether two plant files mean the same drive by a name, apart from its other settings."""
    return now is not None and all(
        getattr(before, each) == getattr(now, each) for each in ("line", "protocol", "address", "options")
    )
