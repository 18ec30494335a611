"""A command from a door, from who asks to what came of it: rights, freshness, lease, audit, bus, answer.

A stop goes another way: whoever is known may give it, and nothing is waited for before it goes out.
"""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from drivecomm.client import drive_options
from drivecomm.errors import (
    CommandCancelledError,
    DeadlineError,
    DriveCommError,
    LeaseError,
    LinkError,
    NotAnsweringError,
    NotSupported,
    ReplyError,
    UsageError,
    in_one_line,
    meant,
)
from drivecomm.protocol import Stop, parse_drive
from drivecomm.server.callers import Role
from drivecomm.server.door import Answer, Command, Stopped
from drivecomm.server.freshness import check_fresh
from drivecomm.server.keep_orders import keep_order, kept_if_remote
from drivecomm.server.rights import NEEDS, Needs
from drivecomm.server.waits import Waits
from drivecomm.server.wanted import Wanted, keeping_takes_s
from drivecomm.transport import in_own_thread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import AsyncBroadcast, AsyncDrive
    from drivecomm.link import CommandCall
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.callers import Caller
    from drivecomm.server.core import Core
    from drivecomm.server.door import Outcome
    from drivecomm.server.leases import Lease
    from drivecomm.server.observations import EventKind
    from drivecomm.server.served_line import ServedLine

    Whom: TypeAlias = AsyncDrive | AsyncBroadcast

T = TypeVar("T")

_log = logging.getLogger("drivecomm.server")

_ALL = "*"
"""The address of all drives of a protocol."""

_UNKNOWN = Needs(Role.COMMISSION)

_UNSENT = (LinkError, DeadlineError)
"""Errors with which a stop may not have been sent at all."""

_ALONE_S = 10.0
"""How long a command without a lease of its own may take under the one that is taken for it alone."""


class Commands:
    """Carries out what doors ask for, in the core's event loop."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._waits = Waits()

    async def carry_out(self, caller: Caller, command: Command) -> Answer:
        """Carry out a command, if this caller may; what goes wrong is in the answer."""
        try:
            line, config = await self._found_to_stop(command) if command.verb == "stop" else self._found(command)
            self._core.rights.check(caller, command, config)
            if command.verb == "stop":
                return await self._stop(caller, command, line, config)
            # From now on a stop cancels it.
            call = line.order.called(_on_bus(config))
            begin = partial(
                self._begin, caller, kept_if_remote(caller, command), line, config, call=call, came_s=time.monotonic()
            )
            if not NEEDS[command.verb].commands:
                # Asked anew each time, and for no longer than whoever asks is there.
                return await begin()
            return await self._core.answers.once(caller, command, begin)
        except Exception as error:  # noqa: BLE001 - whoever asks is answered
            answer = Answer(id=command.id, outcome="refused", error=_error(command, error))
            if NEEDS.get(command.verb, _UNKNOWN).commands:
                _noted(self._core.audit.refused, caller, command, in_one_line(error))
            return answer

    async def _stop(self, caller: Caller, command: Command, line: ServedLine, config: DriveConfig) -> Answer:
        """Stop a drive, or all of a protocol, and let go of it where it was kept."""
        core, name, how, asked_s = self._core, config.name, stop_kind(command.arguments), time.time()
        line.order.stop_called(_on_bus(config))
        number = _noted(core.audit.stop_asked, caller, command) or 0
        core.table.happened("command", f"stop ({how.value})", drive=name, line=line.line.name, who=str(caller))
        try:
            answer = Answer(id=command.id, outcome="done", result=await self._stopped(command, line, config, how))
        except UsageError as error:
            answer = Answer(id=command.id, outcome="refused", error=error)
        except Exception as error:  # noqa: BLE001 - whoever asks is answered
            answer = Answer(id=command.id, outcome="open", error=_error(command, error))
            core.table.happened("warning", f"stop is not confirmed: {in_one_line(error)}", drive=name, who=str(caller))
        if answer.outcome != "refused":
            for each in line.drives if config.address < 0 else [config]:
                if each.protocol == config.protocol:
                    core.kept.release(each.name, how)
                    self._send_later_where_unsent(caller, each.name, how, answer)
        _noted(core.audit.outcome, caller, command, number, answer)
        _noted(core.remember, caller, command, answer, asked_s)
        return answer

    async def _stopped(self, command: Command, line: ServedLine, config: DriveConfig, how: Stop) -> Any:
        """Send a stop; by the line that is there instead, where the plant file is read again and its own is closed."""
        try:
            return await self._sent(line, config, how)
        except UsageError:
            now, config = await self._found_to_stop(command)
            if now is line:
                raise
            return await self._sent(now, config, how)

    async def _sent(self, line: ServedLine, config: DriveConfig, how: Stop) -> Any:
        whom = await self._built(line, config, arm=False)
        if how in whom.capabilities.stops:
            # What is still tried of an earlier stop must not follow this one and stop the motor another way.
            self._stop_kept_by(line, config, how)
        result = await whom.stop(how)
        if config.address >= 0:
            self._stop_kept_by(line, config, None)
        return result

    def _stop_kept_by(self, line: ServedLine, config: DriveConfig, how: Stop | None) -> None:
        """Say how the motors are stopped that an earlier stop of is still tried; None: no more."""
        for each in line.drives:
            if each.protocol == config.protocol and config.address in {-1, each.address}:
                self._core.kept.stop_by(each.name, how)

    def _send_later_where_unsent(self, caller: Caller, name: str, how: Stop, answer: Answer) -> None:
        """Have a stop that never reached its line sent as soon as that works; of a kept motor, its keeper does so."""
        kept = self._core.kept
        if not isinstance(answer.error, _UNSENT):
            kept.stop_no_more(name)
        elif name not in kept and not self._core.ending:
            kept.stop_later(name, partial(self._sent_later, caller, name, how))

    async def _sent_later(self, caller: Caller, name: str, how: Stop) -> bool:
        """Try to send a stop that could not be sent; returns whether nothing is left to be tried."""
        core = self._core
        config = next((each for each in core.plant.drives if each.name == name), None)
        if config is None:
            return True
        kind: EventKind = "command"
        said = f"stop ({how.value}), sent when the line worked again"
        try:
            await (await self._built(core.line(config.line), config, arm=False)).stop(how)
        except (*_UNSENT, UsageError):
            # Its line may be one that is just read from the plant file again.
            return False
        except Exception as error:  # noqa: BLE001 - it was sent, and nobody waits for it any more
            kind, said = "warning", f"{said}, is not confirmed: {in_one_line(error)}"
        core.table.happened(kind, said, drive=name, line=config.line, who=str(caller))
        return True

    async def stop_all(self, caller: Caller, how: Stop, lines: Sequence[str] = ()) -> Sequence[Stopped]:
        """Stop all drives, or those of these lines, all lines at the same time: by a broadcast first, then each."""
        named = [self._core.line(name) for name in lines] or list(self._core.lines.values())
        answers = await asyncio.gather(*(self._stop_line(caller, line, how) for line in named))
        return [each for on_line in answers for each in on_line]

    async def _stop_line(self, caller: Caller, line: ServedLine, how: Stop) -> Sequence[Stopped]:
        name = line.line.name

        async def stop_everybody(everybody: AsyncBroadcast, used: Stop) -> Stopped:
            to_all = Command(drive=everybody.peer.name, line=name, verb="stop", arguments={"how": used.value})
            answer = await self._stop_everybody(caller, to_all, line, everybody)
            return Stopped(line=name, drive=to_all.drive, how=used, answer=answer)

        async def stop(config: DriveConfig) -> Stopped:
            used = how
            # The stop says it again.
            with suppress(Exception):
                able = (await self._built(line, config, arm=False)).capabilities.stops
                used = how if how in able else Stop.RAMP
            stopping = Command(drive=config.name, verb="stop", arguments={"how": used.value})
            return Stopped(line=name, drive=config.name, how=used, answer=await self.carry_out(caller, stopping))

        # In the order in which they are asked for here; a broadcast that waits or fails holds up no other stop.
        to_all = [stop_everybody(each, used) for each, used in _broadcasts(line, how)]
        return await asyncio.gather(*to_all, *map(stop, line.drives))

    async def _stop_everybody(
        self, caller: Caller, command: Command, line: ServedLine, everybody: AsyncBroadcast
    ) -> Answer:
        """Stop all drives of a protocol by one telegram, which nobody confirms."""
        try:
            self._core.rights.check(caller, replace(command, line=""), line.drives[0])
        except DriveCommError as error:
            return Answer(id="", outcome="refused", error=error)
        line.order.stop_called(command.drive)
        number = _noted(self._core.audit.stop_asked, caller, command) or 0
        answer = Answer(id="", outcome="open")
        try:
            await line.opened()
            await everybody.stop(stop_kind(command.arguments))
        except Exception as error:  # noqa: BLE001 - whoever asks is answered
            answer = Answer(id="", outcome="open", error=_error(command, error))
        _noted(self._core.audit.outcome, caller, command, number, answer)
        return answer

    async def _begin(
        self,
        caller: Caller,
        command: Command,
        line: ServedLine,
        config: DriveConfig,
        *,
        call: CommandCall,
        came_s: float,
    ) -> Answer:
        """Carry out what is no stop. came_s: when it came, on the clock of `time.monotonic`."""
        if not NEEDS[command.verb].commands:
            try:
                whom = await self._built(line, config, arm=False)
                waits = command.verb == "wait"
                result = await (self._waits.wait(whom, command.arguments) if waits else _asked(whom, command))
                return Answer(id=command.id, outcome="done", result=result)
            except UsageError as error:
                return Answer(id=command.id, outcome="refused", error=error)
            except Exception as error:  # noqa: BLE001 - whoever asks is answered
                return Answer(id=command.id, outcome="failed", error=_error(command, error))
        fresh = partial(check_fresh, command, session=self._core.session)
        fresh(time_s=time.time())
        lease, alone = self._lease(caller, command, config)
        try:
            wanted = Wanted(
                core=self._core,
                lease=lease,
                found=lambda: self._found(command)[1],
                config=config,
                call=call,
                fresh=fresh,
                came_s=came_s,
            )
            return await self._command(caller, command, line, config, wanted)
        finally:
            if alone:
                self._core.leases.release(lease)

    def _lease(self, caller: Caller, command: Command, config: DriveConfig) -> tuple[Lease, bool]:
        """Return the lease under which a command is given, and whether it was taken for it alone."""
        leases, now = self._core.leases, time.monotonic()
        if (held := leases.admit(caller, config.name, command.lease, now=now)) is not None:
            return held, False
        order = keep_order(command, config)
        if order is not None and order.policy != "hold":
            raise LeaseError(f"{config.name} is kept running for as long as its commander is there: take a lease first")
        return leases.take(caller, config.name, _ALONE_S, now=now, time_s=time.time()), True

    async def _command(
        self, caller: Caller, command: Command, line: ServedLine, config: DriveConfig, wanted: Wanted
    ) -> Answer:
        core = self._core
        wanted.check()
        asked_s = time.time()
        number = await core.audit.asked(caller, command, wanted.lease)
        try:
            await core.kept.settled(config.name, command.valid_s)
            whom = await self._built(line, config, arm=command.arm)
            wanted.check_all()
            order = keep_order(command, config)
            if order is None:
                result = await _asked(whom.checked(wanted.check_all), command)
            else:
                kept = replace(wanted, own_s=keeping_takes_s(whom.facts))
                result = await core.kept.begin(whom, config, order, wanted.lease, kept.check_all)
            answer = Answer(id=command.id, outcome="done", result=result)
        except Exception as error:  # noqa: BLE001 - whoever asks is answered
            answer = Answer(id=command.id, outcome=_outcome(error), error=_error(command, error))
        text = (
            _said(command)
            if answer.error is None
            else f"{_said(command)}: {answer.outcome}, {in_one_line(answer.error)}"
        )
        core.table.happened("command", text, drive=config.name, line=line.line.name, who=str(caller))
        _noted(core.audit.outcome, caller, command, number, answer)
        _noted(core.remember, caller, command, answer, asked_s)
        return answer

    def _found(self, command: Command) -> tuple[ServedLine, DriveConfig]:
        """Return the line and the drive that are meant. Raises UsageError."""
        if not command.line:
            config = self._core.plant.drive(command.drive)
            line = self._core.line(config.line)
        else:
            line = self._core.line(command.line)
            config = _on(line, command.drive)
        return line, config.with_options(**drive_options(command.options)) if command.options else config

    async def _found_to_stop(self, command: Command) -> tuple[ServedLine, DriveConfig]:
        """Return the same; what the plant does not have is waited for while the plant file is read again."""
        try:
            return self._found(command)
        except UsageError:
            if not self._core.changing:
                raise
        await self._core.settled()
        return self._found(command)

    async def _built(self, line: ServedLine, config: DriveConfig, *, arm: bool) -> Any:
        """Return what carries the verbs, when its line is open. Making one anew reads its model's file, in a thread."""
        await line.opened()
        if config.address < 0:
            return await in_own_thread(line.bus.broadcast, config.protocol, **config.options)
        known = next((each for each in line.drives if each.name == config.name), config)
        if not arm and replace(config, read_only_reason=known.read_only_reason) in line.drives:
            return line.drive(config.name)
        reason = "" if arm else config.why_read_only(self._core.plant.file)
        return await in_own_thread(replace(config, read_only_reason=reason).build, line.bus.drive)


def _broadcasts(line: ServedLine, how: Stop) -> Iterator[tuple[AsyncBroadcast, Stop]]:
    """Yield what reaches all drives of each protocol at once, and how that stops them.

    Drives that could all at once only coast (VABus), where that was not asked for, are stopped one by one.
    """
    for everybody in line.everybody:
        able = everybody.capabilities.stops
        used = next((each for each in (how, Stop.RAMP) if each in able), Stop.COAST)
        if used in able and (used is how or used is not Stop.COAST):
            yield everybody, used


def _on(line: ServedLine, text: str) -> DriveConfig:
    """Return a drive of a line by PROTOCOL:ADDRESS, as the plant has it if it does; all of a protocol by PROTOCOL:*."""
    protocol, _, address = text.partition(":")
    if address == _ALL:
        return replace(parse_drive(f"{protocol}:0"), name=text, address=-1, line=line.line.name)
    if (named := next((each for each in line.drives if each.name == text), None)) is not None:
        return named
    meant_by_it = replace(parse_drive(text), line=line.line.name)
    known = next((each for each in line.drives if str(each) == str(meant_by_it)), None)
    return meant_by_it if known is None else known.with_options(**meant_by_it.options)


def _on_bus(config: DriveConfig) -> str:
    """Return what a bus calls a drive, or all of a protocol."""
    return str(config) if config.address >= 0 else f"{config.protocol}:{_ALL}"


def stop_kind(arguments: Mapping[str, Any]) -> Stop:
    """Return the kind of stop that is asked for. Raises UsageError."""
    text = str(arguments.get("how", "ramp"))
    known = [stop.value for stop in Stop]
    if text not in known:
        raise UsageError(f"unknown kind of stop {text!r}; {meant(text, known, 'use one of')}")
    return Stop(text)


async def _asked(whom: Any, command: Command) -> Any:
    """Have a drive carry out a verb. Raises what that raises, UsageError for arguments that it has not."""
    given = dict(command.arguments)
    verb = getattr(whom, command.verb, None)
    if verb is None:
        raise NotSupported(f"{whom.peer.name} cannot {command.verb}")
    try:
        signature(verb).bind(**given)
    except TypeError as error:
        raise UsageError(f"{command.verb} cannot be asked so: {error}") from None
    return await verb(**given)


def _said(command: Command) -> str:
    """Return a command as people read it: write(parameter=3-03, value=40)."""
    given = ", ".join(f"{name}={value}" for name, value in command.arguments.items() if value not in (None, False))
    return f"{command.verb}({given})" if given else command.verb


def _outcome(error: Exception) -> Outcome:
    """Return what is known of a command that ended with this error."""
    if not isinstance(error, DriveCommError):
        return "open"
    if isinstance(error, UsageError | CommandCancelledError):
        return "refused"
    if isinstance(error, NotAnsweringError):
        # It was not asked.
        return "failed"
    return "open" if isinstance(error, ReplyError | LinkError) else "failed"


def _error(command: Command, error: Exception) -> DriveCommError:
    """Return an error as an answer has it; one that nobody raised on purpose is a mistake, of a package perhaps."""
    if isinstance(error, DriveCommError):
        return error
    _log.error("%s of %s", command.verb, command.drive, exc_info=error)
    return DriveCommError(f"{command.verb} of {command.drive} has failed by a mistake in the program: {error!r}")


def _noted(write: Callable[..., T], *content: Any) -> T | None:
    """Have something written down; that this fails keeps nobody from what is done, a stop least of all."""
    try:
        return write(*content)
    except Exception:  # noqa: BLE001 - see above
        _log.exception("writing down a command")
        return None
