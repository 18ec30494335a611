"""Execution of the commands written to a drive's command registers: authorisation, timing, and each command once.

A stop needs no lease and is sent whatever else the telegram contains. Everything else needs a heartbeat that has
already counted up on the same connection, so that nothing moves when a PLC returns with an old image or when the server
restarts.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections import OrderedDict
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.server import CommandRequest
from drivecomm.server.modbus_tcp.heartbeat import HeldLease, counts_up
from drivecomm.server.modbus_tcp.layout import COMMANDS, HEARTBEAT_AT, SEQUENCE_AT, STOP_AT, STOPS
from drivecomm.server.modbus_tcp.outcomes import NOTHING_YET, UNDER_WAY, Outcome, Reason, Result, refused, result_of
from drivecomm.server.modbus_tcp.register_image import (
    Reference,
    RegisterImage,
    check,
    heartbeat_of,
    holds,
    nothing_held,
    sequence_of,
)

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from drivecomm.server import Caller, ServedPlant, StandingStop
    from drivecomm.server.modbus_tcp.refusals import Refusals

_log = logging.getLogger("drivecomm.server.modbus_tcp")

REFERENCE_EVERY_S = 0.2
"""Shortest interval between references sent for a register that keeps changing."""
_MOST_ADDRESSES = 256
_VERBS = {1: "start", 2: "start", 3: "reset", 4: "set_reference"}
_BACKWARDS, _RESET, _REFERENCE = 2, 3, 4


@dataclass(slots=True)
class CommandResults:
    """Results reported to one address.

    answered: sequence number of the command that `command` is the result of. stops: number of stops received.
    """

    answered: int = 0
    command: Result = NOTHING_YET
    reference: Result = NOTHING_YET
    stop: Result = NOTHING_YET
    stops: int = 0


class RegisterCommander:
    """Commands of a door to one drive; used only within the door's event loop.

    caller: the caller, without its address. lease_s: seconds for which a heartbeat holds the lease.
    """

    def __init__(self, plant: ServedPlant, drive: str, caller: Caller, lease_s: float, refusals: Refusals) -> None:
        self._plant, self._drive, self._anybody, self._refusals = plant, drive, caller, refusals
        self.lease = HeldLease(plant, drive, lease_s)
        self._told: OrderedDict[str, CommandResults] = OrderedDict()
        self._run, self._numbers = secrets.token_urlsafe(6), count(1)
        self._commanding: asyncio.Task[None] | None = None
        self._referring: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._sent: tuple[str, Reference] | None = None
        """The latest reference that was sent, with the key of its lease."""

    def results_of(self, address: str) -> CommandResults:
        """Return the results for an address, whichever of its connections reads them."""
        return self._told.get(address) or CommandResults()

    def _telling(self, address: str) -> CommandResults:
        """Return the stored results of an address; creates them, and drops those of the address unused for longest."""
        found = self._told.setdefault(address, CommandResults())
        self._told.move_to_end(address)
        while len(self._told) > _MOST_ADDRESSES:
            self._told.popitem(last=False)
        return found

    def write(self, image: RegisterImage, first: int, written: tuple[int, ...]) -> None:
        """Process written registers. Raises RefusedRequest, but a stop in the registers has been sent even then."""
        if holds(first, written, STOP_AT):
            self._take_stop(image, written[STOP_AT - first])
        words = image.merged(first, written)
        check(words)
        image.words = words
        if holds(first, written, HEARTBEAT_AT):
            self._take_heartbeat(image, heartbeat_of(words))
        if holds(first, written, SEQUENCE_AT):
            self._take_sequence(image, sequence_of(words))
        self._take_reference(image)

    # Stops

    def _take_stop(self, image: RegisterImage, code: int) -> None:
        before, image.words[0] = image.words[0], code
        if code == before:
            return
        release = image.release_stop
        if not code:
            image.release_stop = nothing_held
        else:
            how, told = STOPS.get(code, "ramp"), self._telling(image.address)
            told.stops += 1
            told.stop = UNDER_WAY
            self._begin(self._stop(image.address, how, told, told.stops))
            # The server repeats the stop for as long as needed.
            image.release_stop = self._plant.hold_stop(self._caller(image.address), self._drive, how)
        release()

    async def _stop(self, address: str, how: str, told: CommandResults, number: int) -> None:
        result = await self._carried_out(address, "stop", {"how": how})
        if result.outcome is Outcome.REFUSED and how != "ramp":
            # A drive that cannot stop in this way must stop nevertheless.
            result = await self._carried_out(address, "stop", {"how": "ramp"})
        if number == told.stops:
            told.stop = result

    def stop_outcome(self, address: str) -> Outcome:
        """Return the present outcome of the latest stop of an address."""
        told = self.results_of(address).stop
        if told.outcome not in (Outcome.DONE, Outcome.OPEN) or told.reason is Reason.MISTAKE:
            return told.outcome
        stands = self._stands()
        if stands is not None and not stands.confirmed:
            return Outcome.OPEN
        # A standing stop that is confirmed is done: nothing can have been started in between.
        return Outcome.DONE if stands is not None else told.outcome

    def _stands(self) -> StandingStop | None:
        try:
            return self._plant.drive(self._drive).standing_stop
        except UsageError:
            return None

    # Heartbeat

    def _take_heartbeat(self, image: RegisterImage, heartbeat: int) -> None:
        before, image.heartbeat = image.heartbeat, heartbeat
        if not heartbeat:
            self.lease.give_back(image, self._caller(image.address))
        elif before is not None and counts_up(before, heartbeat):
            self.lease.counted(image, self._caller(image.address))

    # Commands

    def _take_sequence(self, image: RegisterImage, sequence: int) -> None:
        before, image.sequence = image.sequence, sequence
        told = self._telling(image.address)
        if before is None:
            # An earlier program's result must not pass for the response to a new command of the same number.
            told.answered, told.command, told.reference = 0, NOTHING_YET, NOTHING_YET
            return
        if sequence == before:
            return
        told.answered = sequence
        reason = self._why_not(image)
        if reason is not Reason.NONE:
            told.command = refused(reason)
            self._note_refusal(image, reason)
            return
        told.command = UNDER_WAY
        self._commanding = self._begin(self._command(image, image.command, image.reference, sequence, told))

    def _why_not(self, image: RegisterImage) -> Reason:
        if not image.command:
            return Reason.NO_COMMAND
        if image.stop and image.command != _RESET:
            return Reason.STOP_IS_ON
        if not self.lease.is_held_by(image):
            return Reason.NO_LEASE
        if self._commanding is not None and not self._commanding.done():
            return Reason.BUSY
        is_without = image.command == _REFERENCE and not image.reference.kind
        if is_without or (image.reference.kind and image.command != _RESET and not self._may_refer(image)):
            return Reason.NO_COMMAND if is_without else Reason.NOT_ALLOWED
        return Reason.NONE

    def _is_demanded(self) -> bool:
        """Whether another image or another door demands a stop, for which the server refuses starts."""
        return (stands := self._stands()) is not None and stands.demanded

    def _may_refer(self, image: RegisterImage) -> bool:
        try:
            return "set_reference" in self._plant.may(self._caller(image.address), self._drive)
        except UsageError:
            return False

    async def _command(
        self, image: RegisterImage, code: int, reference: Reference, sequence: int, told: CommandResults
    ) -> None:
        arguments: dict[str, Any] = {} if code == _RESET else dict(reference.arguments)
        if code == _BACKWARDS:
            arguments["reverse"] = True
        key = self.lease.key
        result = await self._carried_out(image.address, _VERBS[code], arguments, key)
        if result.reason is Reason.NO_LEASE and self._is_demanded():
            result = refused(Reason.STOP_IS_ON)
        if code != _RESET and result.outcome is Outcome.DONE:
            self._sent = key, reference
        if told.answered == sequence:
            told.command = result
        if code == _REFERENCE:
            told.reference = result

    # Reference

    def _take_reference(self, image: RegisterImage) -> None:
        if self._wants_reference(image) and (self._referring is None or self._referring.done()):
            self._referring = self._begin(self._refer(image))

    def _wants_reference(self, image: RegisterImage) -> bool:
        is_commanding = self._commanding is not None and not self._commanding.done()
        return (
            bool(image.reference.kind)
            and not image.stop
            and not is_commanding
            and self.lease.is_held_by(image)
            and self._sent != (self.lease.key, image.reference)
        )

    async def _refer(self, image: RegisterImage) -> None:
        told = self._telling(image.address)
        while self._wants_reference(image):
            key, reference = self.lease.key, image.reference
            self._sent = key, reference
            told.reference = UNDER_WAY
            told.reference = await self._carried_out(image.address, "set_reference", reference.arguments, key)
            await asyncio.sleep(REFERENCE_EVERY_S)

    # Calls of the plant

    def _caller(self, address: str) -> Caller:
        return replace(self._anybody, name=address)

    async def _carried_out(self, address: str, verb: str, arguments: dict[str, Any], lease: str = "") -> Result:
        command = CommandRequest(
            drive=self._drive,
            verb=verb,
            arguments=arguments,
            lease=lease,
            id=f"{self._run}/{next(self._numbers)}",
            session=self._plant.session,
        )
        try:
            answer = await self._plant.command(self._caller(address), command)
        except Exception:  # noqa: BLE001 - the PLC is told that it is not known
            _log.exception("%s of %s", verb, self._drive)
            return Result(Outcome.OPEN, Reason.MISTAKE)
        return result_of(answer)

    def _note_refusal(self, image: RegisterImage, reason: Reason) -> None:
        verb = _VERBS.get(image.command, "start")
        why = f"{COMMANDS.get(image.command, 'no command')}: {reason.name.lower().replace('_', ' ')}"
        command = CommandRequest(drive=self._drive, verb=verb, arguments=image.reference.arguments)
        self._refusals.note(self._caller(image.address), command, why)

    def _begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
