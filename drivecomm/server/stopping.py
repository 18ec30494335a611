"""Stops from doors: they need no lease, wait for nothing, and are retried until the drive confirms."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import stop_of_all
from drivecomm.errors import DriveCommError, UsageError, in_one_line, suggestion
from drivecomm.line import result_of
from drivecomm.protocol import Stop
from drivecomm.server.addressing import covered_drives, find_stop_target, on_bus, open_drive
from drivecomm.server.command_results import error_of, record_safely
from drivecomm.server.door import CommandAnswer, CommandRequest, Stopped
from drivecomm.server.merged_stops import StopJob, StopKey

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.bus import AsyncBroadcast
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.callers import Caller
    from drivecomm.server.core import Core
    from drivecomm.server.served_line import ServedLine


class StopExecutor:
    """The executor of stops, in the core's event loop."""

    def __init__(self, core: Core) -> None:
        self._core = core

    async def stop(self, caller: Caller, command: CommandRequest) -> CommandAnswer:
        """Stop a drive, or all drives of a protocol; errors are returned in the answer, not raised."""
        try:
            line, config = await find_stop_target(self._core, command)
            self._core.rights.check(caller, command, config)
            return await self._stop(caller, command, line, config)
        except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
            return CommandAnswer(id=command.id, outcome="refused", error=error_of(command, error))

    async def _stop(
        self, caller: Caller, command: CommandRequest, line: ServedLine, config: DriveConfig
    ) -> CommandAnswer:
        """Stop a drive, or all drives of a protocol, and release the motor if it was kept."""
        core, how = self._core, stop_kind(command.arguments)
        line.order.stop_called(on_bus(config))
        key = StopKey(line.line.name, on_bus(config), how, repr(sorted(command.options.items())))
        job = core.merged_stops.job(key, partial(self._carry_out, command, line, config, how))
        if caller in job.callers:
            # This request is recorded already: repeated stops must not flood the audit or the history.
            return await self._answered(caller, command, line, config, how, job)
        job.callers.add(caller)
        asked_s = time.time()
        number = record_safely(core.audit.record_stop, caller, command) or 0
        core.table.record_event(
            "command", f"stop ({how.value})", drive=config.name, line=line.line.name, who=str(caller)
        )
        answer = await self._answered(caller, command, line, config, how, job)
        record_safely(core.audit.outcome, caller, command, number, answer)
        record_safely(core.remember, caller, command, answer, asked_s)
        return answer

    async def _answered(  # noqa: PLR0917 - all of them describe one stop
        self, caller: Caller, command: CommandRequest, line: ServedLine, config: DriveConfig, how: Stop, job: StopJob
    ) -> CommandAnswer:
        """Return the answer to a stop, and retry an unconfirmed stop until it is confirmed."""
        core, drives = self._core, covered_drives(line, config)
        try:
            await result_of(job.task)
        except UsageError as error:
            return CommandAnswer(id=command.id, outcome="refused", error=error)
        except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
            answer = CommandAnswer(id=command.id, outcome="open", error=error_of(command, error))
            if not drives or core.ending:
                text = f"stop is not confirmed: {in_one_line(error)}"
                core.table.record_event("warning", text, drive=config.name, who=str(caller))
        else:
            answer = CommandAnswer(id=command.id, outcome="done")
        there = {each.name for each in core.plant.drives}
        for name in drives:
            if answer.error is not None or not core.kept.outlasts_stop(name, command.lease):
                core.kept.release(name, how)
            if core.ending or name not in there:
                continue
            if answer.error is not None:
                number = job.number or core.standing_stops.sent([name], how)
                core.standing_stops.stand(name, how, str(caller), number, answer.error)
            elif config.address < 0:
                # A broadcast is not confirmed, so each drive also gets its own stop.
                core.standing_stops.send_soon(name, how, str(caller))
        return answer

    async def _carry_out(
        self, command: CommandRequest, line: ServedLine, config: DriveConfig, how: Stop, job: StopJob
    ) -> None:
        """Send a stop. If its line was closed because the plant file is read again, send it on the new line."""
        try:
            await self._sent(line, config, how, job)
        except UsageError:
            now, config = await find_stop_target(self._core, command)
            if now is line:
                raise
            await self._sent(now, config, how, job)

    async def _sent(self, line: ServedLine, config: DriveConfig, how: Stop, job: StopJob) -> None:
        core, drives = self._core, covered_drives(line, config)
        whom: Any = await open_drive(core, line, config, arm=False)
        if how in whom.capabilities.stops:
            # Retries of an earlier stop must not follow this one and stop the motor in another way.
            job.number = core.standing_stops.sent(drives, how)
            for name in drives:
                core.kept.stop_by(name, how)
        await whom.with_stop_notice(job.goes_out).stop(how)
        if config.address >= 0:
            for name in drives:
                core.kept.stop_by(name, None)
                core.standing_stops.confirmed(name)

    async def stop_all(self, caller: Caller, how: Stop, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, or those of some lines, in parallel: on each line by a broadcast, then each drive."""
        named = [self._core.line(name) for name in lines] or list(self._core.lines.values())
        answers = await asyncio.gather(*(self._stop_line(caller, line, how) for line in named))
        return [each for on_line in answers for each in on_line]

    async def _stop_line(self, caller: Caller, line: ServedLine, how: Stop) -> Sequence[Stopped]:
        name = line.line.name

        async def stop_everybody(everybody: AsyncBroadcast, used: Stop) -> Stopped:
            to_all = CommandRequest(drive=everybody.peer.name, line=name, verb="stop", arguments={"how": used.value})
            answer = await self._stop_everybody(caller, to_all, line, everybody)
            return Stopped(line=name, drive=to_all.drive, how=used, answer=answer)

        async def stop(config: DriveConfig) -> Stopped:
            used = how
            # An error here is ignored, because the stop below reports it, too.
            with suppress(Exception):
                able = (await open_drive(self._core, line, config, arm=False)).capabilities.stops
                used = how if how in able else Stop.RAMP
            stopping = CommandRequest(drive=config.name, verb="stop", arguments={"how": used.value})
            return Stopped(line=name, drive=config.name, how=used, answer=await self.stop(caller, stopping))

        # Queued in this order, the broadcasts first; a broadcast that waits or fails delays no other stop.
        to_all = [stop_everybody(each, used) for each in line.everybody if (used := stop_of_all(each, how))]
        return await asyncio.gather(*to_all, *map(stop, line.drives))

    async def _stop_everybody(
        self, caller: Caller, command: CommandRequest, line: ServedLine, everybody: AsyncBroadcast
    ) -> CommandAnswer:
        """Stop all drives of a protocol by one broadcast, which no drive confirms."""
        try:
            self._core.rights.check(caller, replace(command, line=""), line.drives[0])
        except DriveCommError as error:
            return CommandAnswer(id="", outcome="refused", error=error)
        line.order.stop_called(command.drive)
        number = record_safely(self._core.audit.record_stop, caller, command) or 0
        answer = CommandAnswer(id="", outcome="open")
        try:
            await line.opened()
            await everybody.stop(stop_kind(command.arguments))
        except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
            answer = CommandAnswer(id="", outcome="open", error=error_of(command, error))
        record_safely(self._core.audit.outcome, caller, command, number, answer)
        return answer


def stop_kind(arguments: Mapping[str, Any]) -> Stop:
    """Return the kind of stop in the arguments of a command. Raises UsageError."""
    text = str(arguments.get("how", "ramp"))
    known = [stop.value for stop in Stop]
    if text not in known:
        raise UsageError(f"unknown kind of stop {text!r}; {suggestion(text, known, 'use one of')}")
    return Stop(text)
