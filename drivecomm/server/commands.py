"""The path of a command from a door: rights, freshness, lease, audit, bus, answer.

A stop takes a shorter path: every known caller may give one, and it is sent without waiting for anything.
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any

from drivecomm.errors import LeaseError, NotSupported, UsageError, in_one_line
from drivecomm.server.addressing import find_target, on_bus, open_drive
from drivecomm.server.callers import Role
from drivecomm.server.command_results import error_of, outcome_of, record_safely
from drivecomm.server.command_words import command_words
from drivecomm.server.door import CommandAnswer, CommandRequest
from drivecomm.server.freshness import check_fresh
from drivecomm.server.keep_settings import check_kept, keep_if_remote, keep_settings_of
from drivecomm.server.pending_command import PendingCommand, keeping_takes_s
from drivecomm.server.rights import NEEDS, Needs
from drivecomm.server.stopping import StopExecutor
from drivecomm.server.wait_limits import Waits
from drivecomm.server.writes import Write

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.link import CommandCall
    from drivecomm.protocol import DriveConfig, Stop
    from drivecomm.server.callers import Caller
    from drivecomm.server.core import Core
    from drivecomm.server.door import Stopped
    from drivecomm.server.leases import Lease
    from drivecomm.server.served_line import ServedLine

_UNKNOWN = Needs(Role.COMMISSION)

_ALONE_S = 10.0
"""Duration of the short lease that is taken for a command without one, in seconds."""


class CommandExecutor:
    """The executor of commands from doors, in the core's event loop."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._waits = Waits()
        self._stopping = StopExecutor(core)

    async def carry_out(self, caller: Caller, command: CommandRequest) -> CommandAnswer:
        """Carry out a command if its caller may; errors are returned in the answer, not raised."""
        if command.verb == "stop":
            return await self._stopping.stop(caller, command)
        try:
            line, config = find_target(self._core, command)
            self._core.rights.check(caller, command, config)
            # From here on, a stop cancels this command.
            call = line.order.called(on_bus(config))
            begin = partial(
                self._begin, caller, keep_if_remote(caller, command), line, config, call=call, came_s=time.monotonic()
            )
            if not NEEDS[command.verb].commands:
                # Reads and waits are not cached by their id, and end when their caller goes.
                return await begin()
            return await self._core.answers.once(caller, command, begin)
        except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
            answer = CommandAnswer(id=command.id, outcome="refused", error=error_of(command, error))
            if NEEDS.get(command.verb, _UNKNOWN).commands:
                record_safely(self._core.audit.refused, caller, command, in_one_line(error))
            return answer

    async def stop_all(self, caller: Caller, how: Stop, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, or those of some lines, in parallel: on each line by a broadcast, then each drive."""
        return await self._stopping.stop_all(caller, how, lines)

    async def _begin(
        self,
        caller: Caller,
        command: CommandRequest,
        line: ServedLine,
        config: DriveConfig,
        *,
        call: CommandCall,
        came_s: float,
    ) -> CommandAnswer:
        """Carry out a command other than a stop. came_s: its arrival time on the clock of `time.monotonic`."""
        if not NEEDS[command.verb].commands:
            try:
                whom = await open_drive(self._core, line, config, arm=False)
                waits = command.verb == "wait"
                result = await (self._waits.wait(whom, command.arguments) if waits else _call_verb(whom, command))
                return CommandAnswer(id=command.id, outcome="done", result=result)
            except UsageError as error:
                return CommandAnswer(id=command.id, outcome="refused", error=error)
            except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
                return CommandAnswer(id=command.id, outcome="failed", error=error_of(command, error))
        fresh = partial(check_fresh, command, session=self._core.session)
        fresh(time_s=time.time())
        lease, alone = self._lease(caller, command, config)
        try:
            wanted = PendingCommand(
                core=self._core,
                lease=lease,
                found=lambda: find_target(self._core, command)[1],
                config=config,
                call=call,
                fresh=fresh,
                came_s=came_s,
            )
            return await self._command(caller, command, line, config, wanted)
        finally:
            if alone:
                self._core.leases.release(lease)

    def _lease(self, caller: Caller, command: CommandRequest, config: DriveConfig) -> tuple[Lease, bool]:
        """Return the lease for a command, and whether it was taken for this command only."""
        leases, now = self._core.leases, time.monotonic()
        if (held := leases.admit(caller, config.name, command.lease, now=now)) is not None:
            return held, False
        order = keep_settings_of(command, config)
        if order is not None and order.policy != "hold":
            raise LeaseError(
                f"{config.name} is kept running only while its commander holds a lease: acquire a lease first"
            )
        return leases.take(caller, config.name, _ALONE_S, now=now, time_s=time.time()), True

    async def _command(
        self, caller: Caller, command: CommandRequest, line: ServedLine, config: DriveConfig, wanted: PendingCommand
    ) -> CommandAnswer:
        core = self._core
        wanted.check()
        core.merged_stops.commanded(line.line.name)
        asked_s = time.time()
        number = await core.audit.record_command(caller, command, wanted.lease)
        core.writes.note(config.name, command, Write(str(caller), number, asked_s), now_s=time.monotonic())
        try:
            await core.kept.settled(config.name, command.valid_s)
            result = await self._sent(caller, command, line, config, wanted)
            answer = CommandAnswer(id=command.id, outcome="done", result=result)
        except Exception as error:  # noqa: BLE001 - the caller gets every error in the answer
            answer = CommandAnswer(id=command.id, outcome=outcome_of(error), error=error_of(command, error))
        words = command_words(command.verb, command.arguments)
        text = words if answer.error is None else f"{words}: {answer.outcome}, {in_one_line(answer.error)}"
        core.table.record_event("command", text, drive=config.name, line=line.line.name, who=str(caller))
        record_safely(core.audit.outcome, caller, command, number, answer)
        record_safely(core.remember, caller, command, answer, asked_s)
        return answer

    async def _sent(
        self, caller: Caller, command: CommandRequest, line: ServedLine, config: DriveConfig, wanted: PendingCommand
    ) -> Any:
        core = self._core
        whom = await open_drive(core, line, config, arm=command.arm)
        order = keep_settings_of(command, config)
        starts = order.start if order is not None else whom.may_start(command.verb, **command.arguments)
        wanted = replace(wanted, starts=starts)
        wanted.check_all()
        check_kept(caller, command, whom)
        with core.standing_stops.giving_way(config.name, str(caller)) if starts else nullcontext():
            if order is None:
                return await _call_verb(whom.with_check(wanted.check_all), command)
            kept = replace(wanted, own_s=keeping_takes_s(whom.facts))
            return await core.kept.begin(whom, config, order, wanted.lease, kept.check_all)


async def _call_verb(whom: Any, command: CommandRequest) -> Any:
    """Call a verb of a drive with the arguments of the command, and return its result.

    Raises the errors of the verb, and UsageError for arguments that the verb does not have.
    """
    given = dict(command.arguments)
    verb = getattr(whom, command.verb, None)
    if verb is None:
        raise NotSupported(f"{whom.peer.name} cannot {command.verb}")
    try:
        signature(verb).bind(**given)
    except TypeError as error:
        raise UsageError(f"{command.verb} has invalid arguments: {error}") from None
    return await verb(**given)
