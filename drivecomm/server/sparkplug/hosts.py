"""Messages of hosts: commands for drives and for the edge node, with bounded queues and without blocking.

Stops are carried out immediately, in parallel to everything else. Other commands of a drive are carried out one after
the other; excess commands are refused. A motor started by a host is kept until a host goes offline.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, NotAllowedError, UsageError, in_one_line
from drivecomm.server import CommandAnswer, CommandRequest
from drivecomm.server.sparkplug.commanding import commands_in, is_start
from drivecomm.server.sparkplug.edge_node import REBIRTH
from drivecomm.server.sparkplug.payload import DataType, Metric, decode_payload, typed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.broker import ReceivedMessage
    from drivecomm.server.sparkplug.edge_node import EdgeNode
    from drivecomm.server.sparkplug.payload import Payload
    from drivecomm.server.sparkplug.topics import SparkplugTopics

MOST_WAITING = 5
"""Maximum commands in the queue of one drive; they expire after two seconds anyway."""
MOST_COMMANDS = 20
"""Maximum commands per second for all drives together, far more than operators cause."""
MOST_REFUSALS = 10
"""Refusals recorded in the audit per second; further ones are only counted."""
MOST_STOPS = 3
"""Maximum concurrent stops of one drive."""
LEASE_S = 10.0
"""Seconds for which a motor is kept after the last sign of the primary host."""

_log = logging.getLogger("drivecomm.server")


class Hosts:
    """Execution of commands from hosts. told: called with the outcome of a command. caller: role and name of hosts."""

    def __init__(
        self,
        plant: ServedPlant,
        caller: Caller,
        topics: SparkplugTopics,
        told: Callable[[CommandRequest, CommandAnswer, str], None],
    ) -> None:
        self.rebirth = asyncio.Event()
        """Set when a host requests new births."""
        self._plant, self._caller, self._topics, self._told = plant, caller, topics, told
        self._waiting: dict[str, asyncio.Queue[tuple[CommandRequest, int]]] = {}
        self._working: set[asyncio.Task[None]] = set()
        self._stopping: dict[str, set[asyncio.Task[None]]] = defaultdict(set)
        self._again: dict[str, CommandRequest] = {}
        self._stops: Counter[str] = Counter()
        """Count of stops and host losses per drive: a command from before such an event is not sent after it."""
        self._leases: dict[str, str] = {}
        self._giving_back: set[asyncio.Task[None]] = set()
        self._admits = False
        self._admitted = self._refused = self._untold = 0
        self._second = 0.0

    def heard(self, received: ReceivedMessage, node: EdgeNode) -> None:
        """Process a message for the edge node or for a drive; never blocks and never raises."""
        try:
            if received.topic == self._topics.node_commands:
                self._node_command(received)
            elif device := self._topics.device_of(received.topic):
                drive = node.drive_of(device)
                if drive is None:
                    raise UsageError(f"there is no drive {device!r}")
                self._drive_command(received, node, drive)
        except DriveCommError as error:
            self._refuse(CommandRequest(drive=received.topic[-100:], verb="command"), error)

    def admit(self) -> None:
        """Accept commands, because hosts have the births of the drives."""
        self._admits = True

    async def lead(self) -> None:
        """Renew the leases of motors started by hosts, until cancelled; then the leases expire."""
        while True:
            for drive, key in list(self._leases.items()):
                with suppress(DriveCommError):
                    if self._plant.drive(drive).kept:
                        await self._plant.renew_lease(self._caller, drive, key, LEASE_S)
                        continue
                await self._let_go(drive)
            await asyncio.sleep(LEASE_S / 5)

    def host_left(self) -> None:
        """Release the leases of motors started by hosts, so that their link-loss policies apply."""
        for drive in {*self._leases, *self._waiting}:
            self._stops[drive] += 1
            task = asyncio.create_task(self._let_go(drive), name=f"lease of {drive}")
            self._giving_back.add(task)
            task.add_done_callback(self._giving_back.discard)

    def forget(self) -> None:
        """Accept only stops until the next births, because the session has ended."""
        self._admits = False
        for task in self._working:
            task.cancel()
        self._waiting.clear()
        self.rebirth.clear()

    def _node_command(self, received: ReceivedMessage) -> None:
        if received.retained:
            raise NotAllowedError("retained commands are not sent")
        for metric in decode_payload(received.payload).metrics:
            if metric.name != REBIRTH:
                raise UsageError(f"{metric.name[:100]!r} of the edge node cannot be written; there is {REBIRTH}")
            if typed(metric, DataType.BOOLEAN).value:
                self.rebirth.set()

    def _drive_command(self, received: ReceivedMessage, node: EdgeNode, drive: str) -> None:
        try:
            if received.retained:
                raise NotAllowedError(f"retained commands are not sent; remove it from {received.topic}")
            payload = decode_payload(received.payload)
            wanted = commands_in(payload, _named(payload, node, drive), drive)
        except DriveCommError as error:
            self._refuse(CommandRequest(drive=drive, verb="command"), error)
            return
        for command in wanted:
            if command.verb == "stop":
                self._stop(command)
            else:
                self._put(command)

    def _stop(self, command: CommandRequest) -> None:
        drive = command.drive
        self._stops[drive] += 1
        waiting = self._waiting.get(drive)
        while waiting is not None and not waiting.empty():
            self._refuse(waiting.get_nowait()[0], _stopped(drive))
        if len(self._stopping[drive]) >= MOST_STOPS:
            # In a flood, one more stop is sent after all others.
            self._again[drive] = command
            return
        task = asyncio.create_task(self._carry_out(command, 0), name=f"stop of {drive}")
        self._stopping[drive].add(task)
        task.add_done_callback(lambda done: self._has_stopped(drive, done))

    def _has_stopped(self, drive: str, task: asyncio.Task[None]) -> None:
        self._stopping[drive].discard(task)
        again = self._again.pop(drive, None)
        if again is not None and not task.cancelled():
            self._stop(again)

    def _put(self, command: CommandRequest) -> None:
        if not self._admits:
            self._refuse(command, NotAllowedError("the edge node has no session; wait for its births"))
            return
        self._count()
        self._admitted += 1
        if self._admitted > MOST_COMMANDS:
            self._refuse(command, NotAllowedError(f"hosts send more than {MOST_COMMANDS} commands in a second"))
            return
        waiting = self._waiting.get(command.drive)
        if waiting is None:
            waiting = self._waiting[command.drive] = asyncio.Queue(MOST_WAITING)
            task = asyncio.create_task(self._one_by_one(waiting), name=f"commands of {command.drive}")
            self._working.add(task)
            task.add_done_callback(self._working.discard)
        try:
            waiting.put_nowait((command, self._stops[command.drive]))
        except asyncio.QueueFull:
            self._refuse(command, NotAllowedError(f"{command.drive} already has {MOST_WAITING} queued commands"))

    async def _one_by_one(self, waiting: asyncio.Queue[tuple[CommandRequest, int]]) -> None:
        while True:
            await self._carry_out(*await waiting.get())

    async def _carry_out(self, command: CommandRequest, stops: int) -> None:
        """Carry out a command. stops: stop count of its drive when the command arrived."""
        try:
            answer = await self._answer(command, stops)
        except DriveCommError as error:
            self._refuse(command, error)
            return
        except Exception:  # noqa: BLE001 - the next command is another one
            _log.exception("%s of %s", command.verb, command.drive)
            return
        self._told(command, answer, "" if answer.error is None else in_one_line(answer.error))

    async def _answer(self, command: CommandRequest, stops: int) -> CommandAnswer:
        drive = command.drive
        if command.verb == "stop":
            answer = await self._plant.command(self._caller, command)
            await self._let_go(drive)
            return answer
        key = self._leases.get(drive, "")
        starts = is_start(command) and not key
        if starts:
            if not self._topics.host:
                raise NotAllowedError(
                    f"{command.verb} of {drive} needs a host responsible for the motor; write host = in [[door]], "
                    "the id of the primary host application"
                )
            key = (await self._plant.take_lease(self._caller, drive, LEASE_S)).key
            self._leases[drive] = key
        if stops != self._stops[drive]:
            # No await between this check and the handover, so that a later stop is queued behind the command.
            await self._let_go(drive)
            raise _stopped(drive)
        answer = await self._plant.command(self._caller, replace(command, lease=key))
        if starts and answer.outcome == "refused":
            await self._let_go(drive)
        return answer

    def _count(self) -> None:
        """Reset the counters each second."""
        if (now := time.monotonic()) - self._second >= 1.0:
            self._second, self._refused, self._admitted = now, 0, 0

    async def _let_go(self, drive: str) -> None:
        key = self._leases.pop(drive, None)
        if key is not None:
            with suppress(DriveCommError):
                await self._plant.end_lease(self._caller, drive, key)

    def _refuse(self, command: CommandRequest, error: DriveCommError) -> None:
        """Record a refusal and report it to hosts; in a flood, only the number of refusals."""
        self._count()
        self._refused += 1
        if self._refused > MOST_REFUSALS:
            self._untold += 1
            return
        why = in_one_line(error)
        if self._untold:
            why, self._untold = f"{why} (and {self._untold} other messages before it were refused)", 0
        self._plant.refuse(self._caller, command, why)
        self._told(command, CommandAnswer(id=command.id, outcome="refused", error=error), why)


def _stopped(drive: str) -> NotAllowedError:
    return NotAllowedError(f"{drive} was sent a stop, or its host went offline, after this command, which was not sent")


def _named(payload: Payload, node: EdgeNode, drive: str) -> Sequence[Metric]:
    """Return the metrics of a message by name. Unknown aliases get a name that is refused later."""
    found = []
    for metric in payload.metrics:
        try:
            found.append(node.named(drive, metric))
        except UsageError:
            found.append(metric._replace(name=f"alias {metric.alias}"))
    return found
