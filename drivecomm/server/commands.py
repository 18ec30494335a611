"""A command from a door, from who asks to what came of it: rights, freshness, lease, audit, bus, answer.

A stop goes another way: whoever is known may give it, and nothing is waited for before it goes out.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.client import drive_options
from drivecomm.errors import (
    CommandCancelledError,
    DriveCommError,
    LeaseError,
    LinkError,
    NotAnsweringError,
    NotSupported,
    ReplyError,
    UsageError,
    meant,
)
from drivecomm.protocol import DriveState, Stop, exact, parse_drive
from drivecomm.server.callers import LOCAL, Role
from drivecomm.server.door import Answer, Command, Stopped
from drivecomm.server.freshness import check_fresh
from drivecomm.server.kept import KeepOrder, KeptMotor
from drivecomm.server.rights import NEEDS, Needs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from drivecomm.bus import AsyncBroadcast, AsyncDrive
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.callers import Caller
    from drivecomm.server.core import Core
    from drivecomm.server.door import Outcome
    from drivecomm.server.leases import Lease
    from drivecomm.server.served_line import ServedLine

    Whom: TypeAlias = AsyncDrive | AsyncBroadcast

_ALL = "*"
"""The address of all drives of a protocol."""

_UNKNOWN = Needs(Role.COMMISSION)

_ALONE_S = 10.0
"""How long a command without a lease of its own may take under the one that is taken for it alone."""


class Commands:
    """Carries out what doors ask for, in the core's event loop."""

    def __init__(self, core: Core) -> None:
        self._core = core

    async def carry_out(self, caller: Caller, command: Command) -> Answer:
        """Carry out a command, if this caller may; what goes wrong is in the answer."""
        try:
            line, config = self._found(command)
            self._core.rights.check(caller, command, config)
            if command.verb == "stop":
                return await self._stop(caller, command, line, config)
            begin = partial(self._begin, caller, _kept_if_remote(caller, command), line, config, time.monotonic())
            return await self._core.answers.once(caller, command, begin)
        except DriveCommError as error:
            if NEEDS.get(command.verb, _UNKNOWN).commands:
                self._core.audit.refused(caller, command, _flat(error))
            return Answer(id=command.id, outcome="refused", error=error)

    async def _stop(self, caller: Caller, command: Command, line: ServedLine, config: DriveConfig) -> Answer:
        """Stop a drive, or all of a protocol, and let go of it where it was kept."""
        core, name, how, asked_s = self._core, config.name, _how(command.arguments), time.time()
        kept = core.kept.get(name)
        if kept is not None:
            kept.stop_by(how)
        number = core.audit.stop_asked(caller, command)
        core.table.happened("command", f"stop ({how.value})", drive=name, line=line.line.name, who=str(caller))
        try:
            whom = await self._built(line, config, arm=False)
            answer = Answer(id=command.id, outcome="done", result=await whom.stop(how))
        except UsageError as error:
            answer = Answer(id=command.id, outcome="refused", error=error)
        except DriveCommError as error:
            answer = Answer(id=command.id, outcome="open", error=error)
            core.table.happened("command", f"stop is not confirmed: {_flat(error)}", drive=name, who=str(caller))
        if kept is not None:
            core.release(name)
        core.audit.outcome(caller, command, number, answer)
        core.remember(caller, command, answer, asked_s)
        return answer

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
            try:
                able = (await self._built(line, config, arm=False)).capabilities.stops
                used = how if how in able else Stop.RAMP
            except DriveCommError:
                # The stop says it again.
                pass
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
        number = self._core.audit.stop_asked(caller, command)
        answer = Answer(id="", outcome="open")
        try:
            await line.opened()
            await everybody.stop(_how(command.arguments))
        except DriveCommError as error:
            answer = Answer(id="", outcome="open", error=error)
        self._core.audit.outcome(caller, command, number, answer)
        return answer

    async def _begin(
        self, caller: Caller, command: Command, line: ServedLine, config: DriveConfig, came_s: float
    ) -> Answer:
        """Carry out what is no stop. came_s: when it came, on the clock of `time.monotonic`."""
        if not NEEDS[command.verb].commands:
            try:
                whom = await self._built(line, config, arm=False)
                if command.verb == "watched":
                    self._watched(whom, config, **command.arguments)
                    return Answer(id=command.id, outcome="done")
                return Answer(id=command.id, outcome="done", result=await _asked(whom, command))
            except UsageError as error:
                return Answer(id=command.id, outcome="refused", error=error)
            except DriveCommError as error:
                return Answer(id=command.id, outcome="failed", error=error)
        fresh = partial(check_fresh, command, session=self._core.session)
        fresh(time_s=time.time())
        lease, alone = self._lease(caller, command, config)
        try:
            check = partial(self._still_fresh, fresh, came_s)
            return await self._command(caller, command, line, config, lease=lease, still_fresh=check)
        finally:
            if alone:
                self._core.leases.release(lease)

    def _watched(self, whom: AsyncDrive, config: DriveConfig, *, silence_s: Any = None, **unknown: Any) -> None:
        """Take note how long a drive's watchdog waits; of one that is kept, its keeper knows better."""
        if unknown:
            raise UsageError(f"watched has no argument {min(unknown)!r}; it has silence_s")
        known = None if silence_s is None else float(exact(silence_s, "watchdog time"))
        if config.name not in self._core.kept:
            whom.watched(known)

    def _lease(self, caller: Caller, command: Command, config: DriveConfig) -> tuple[Lease, bool]:
        """Return the lease under which a command is given, and whether it was taken for it alone."""
        leases, now = self._core.leases, time.monotonic()
        if (held := leases.admit(caller, config.name, command.lease, now=now)) is not None:
            return held, False
        if self._kept_by(command, config):
            raise LeaseError(f"{config.name} is kept running for as long as its commander is there: take a lease first")
        return leases.take(caller, config.name, _ALONE_S, now=now, time_s=time.time()), True

    def _kept_by(self, command: Command, config: DriveConfig) -> str:
        """Return the link-loss policy under which a command has its motor kept, empty where it does not."""
        order = _keep_order(command, config)
        return "" if order is None or order.policy == "hold" else order.policy

    async def _command(
        self,
        caller: Caller,
        command: Command,
        line: ServedLine,
        config: DriveConfig,
        *,
        lease: Lease,
        still_fresh: Callable[[], None],
    ) -> Answer:
        core = self._core
        if core.ending:
            raise UsageError("the server ends; nothing is commanded through it any more but a stop")
        asked_s = time.time()
        number = await core.audit.asked(caller, command, lease)
        try:
            whom = await self._built(line, config, arm=command.arm)
            still_fresh()
            order = _keep_order(command, config)
            result = await (_asked(whom, command) if order is None else self._keep(whom, config, order, lease))
            answer = Answer(id=command.id, outcome="done", result=result)
        except DriveCommError as error:
            answer = Answer(id=command.id, outcome=_outcome(error), error=error)
        text = _said(command) if answer.error is None else f"{_said(command)}: {answer.outcome}, {_flat(answer.error)}"
        core.table.happened("command", text, drive=config.name, line=line.line.name, who=str(caller))
        core.audit.outcome(caller, command, number, answer)
        core.remember(caller, command, answer, asked_s)
        return answer

    def _still_fresh(self, fresh: Callable[..., None], came_s: float) -> None:
        fresh(time_s=time.time(), waited_s=time.monotonic() - came_s)

    async def _keep(self, whom: Any, config: DriveConfig, order: KeepOrder, lease: Lease) -> Mapping[str, Any]:
        """Start a motor and keep it in hand; returns what its commander wants to know of that."""
        core = self._core
        if config.name in core.kept:
            raise LeaseError(f"{config.name} is kept running already; stop it first")
        kept = KeptMotor(whom, order, core.teller(config))
        if order.policy != "hold":
            core.kept[config.name] = kept
        try:
            await kept.begin()
        except BaseException:
            core.kept.pop(config.name, None)
            raise
        core.watch(config.name, lease)
        return {"policy": order.policy, "watchdog": kept.watchdog}

    def _found(self, command: Command) -> tuple[ServedLine, DriveConfig]:
        """Return the line and the drive that are meant. Raises UsageError."""
        if not command.line:
            config = self._core.plant.drive(command.drive)
            line = self._core.line(config.line)
        else:
            line = self._core.line(command.line)
            config = _on(line, command.drive)
        return line, config.with_options(**drive_options(command.options)) if command.options else config

    async def _built(self, line: ServedLine, config: DriveConfig, *, arm: bool) -> Any:
        """Return what carries the verbs, when its line is open. Making one anew reads its model's file, in a thread."""
        await line.opened()
        if config.address < 0:
            return await asyncio.to_thread(line.bus.broadcast, config.protocol, **config.options)
        if not arm and config in line.drives:
            return line.drive(config.name)
        reason = "" if arm else config.why_read_only(self._core.plant.file)
        return await asyncio.to_thread(replace(config, read_only_reason=reason).build, line.bus.drive)


def _broadcasts(line: ServedLine, how: Stop) -> Iterator[tuple[AsyncBroadcast, Stop]]:
    """Yield what reaches all drives of each protocol at once, and how that stops them.

    Drives that could all at once only coast (VABus), where that was not asked for, are stopped one by one.
    """
    for everybody in line.everybody:
        able = everybody.capabilities.stops
        used = next((each for each in (how, Stop.RAMP) if each in able), Stop.COAST)
        if used in able and (used is how or used is not Stop.COAST):
            yield everybody, used


def _kept_if_remote(caller: Caller, command: Command) -> Command:
    """Return a command; a start from a network is one that is kept, by the policy that the plant file says."""
    if caller.door == LOCAL or command.verb not in ("start", "reverse"):
        return command
    reverse = command.verb == "reverse" or bool(command.arguments.get("reverse"))
    return replace(command, verb="keep", arguments={**command.arguments, "reverse": reverse})


def _on(line: ServedLine, text: str) -> DriveConfig:
    """Return a drive of a line by PROTOCOL:ADDRESS, as the plant has it if it does; all of a protocol by PROTOCOL:*."""
    protocol, _, address = text.partition(":")
    if address == _ALL:
        return replace(parse_drive(f"{protocol}:0"), name=text, address=-1, line=line.line.name)
    known = next((each for each in line.drives if text in (each.name, str(each))), None)
    return known or replace(parse_drive(text), line=line.line.name)


def _how(arguments: Mapping[str, Any]) -> Stop:
    text = str(arguments.get("how", "ramp"))
    known = [stop.value for stop in Stop]
    if text not in known:
        raise UsageError(f"unknown kind of stop {text!r}; {meant(text, known, 'use one of')}")
    return Stop(text)


def _keep_order(command: Command, config: DriveConfig) -> KeepOrder | None:
    """Return how a motor is to be kept by a command, None for one that keeps none. Raises UsageError."""
    given = dict(command.arguments)
    if command.verb != "keep":
        return None
    said = config.link_loss
    policy = given.pop("policy", None) or (said.policy if said else None)
    if policy is None:
        raise UsageError(
            f"no motor is started without saying what it does when its commander falls silent; write link_loss of "
            f"{config.name} into the plant file, or give policy"
        )
    usual_s: Any = said.watchdog_s if said and said.policy == policy else 5
    unknown = given.keys() - {"watchdog_s", "reverse", "percent", "hz"}
    if unknown:
        raise UsageError(f"keep has no argument {min(unknown)!r}; it has policy, watchdog_s, reverse, percent and hz")
    return KeepOrder(policy=policy, **{"watchdog_s": usual_s, **given})


async def _asked(whom: Any, command: Command) -> Any:
    """Have a drive carry out a verb. Raises what that raises, UsageError for arguments that it has not."""
    given = dict(command.arguments)
    if command.verb == "wait":
        goal = str(given.pop("goal", ""))
        states = {each.value: each for each in DriveState}
        return await whom.wait_for(states.get(goal, goal), **given)
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


def _outcome(error: DriveCommError) -> Outcome:
    """Return what is known of a command that ended with this error."""
    if isinstance(error, UsageError | CommandCancelledError):
        return "refused"
    if isinstance(error, NotAnsweringError):
        # It was not asked.
        return "failed"
    return "open" if isinstance(error, ReplyError | LinkError) else "failed"


def _flat(error: Exception) -> str:
    return " ".join(str(error).split())
