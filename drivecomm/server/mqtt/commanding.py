"""Commands that come over a broker: what could be old, replayed or somebody else's is refused, and a stop goes out.

The broker can keep, queue and repeat what it is given. So a command names the session of this connection, which changes
with each, says when it was given and for how long it counts, and has an id; what was retained is refused in any case.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections import OrderedDict
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.client import error_content, json_text, plain
from drivecomm.errors import DriveCommError, LinkError, NotAllowedError, UsageError, in_one_line
from drivecomm.server import NEEDS, Answer, Command
from drivecomm.server.broker import Message
from drivecomm.server.mqtt.asked import command_of, commanded, requested, stopped, why_incomplete
from drivecomm.server.mqtt.floods import PAUSE_S, Flood
from drivecomm.server.mqtt.requests import carried_out
from drivecomm.server.mqtt.stops import Stops
from drivecomm.server.mqtt.topics import name_of

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.broker import Connection, Received
    from drivecomm.server.mqtt.callers import BrokerCallers
    from drivecomm.server.mqtt.topics import Topics

MOST_AT_ONCE = 50
"""Commands that are under way; stops are not counted."""
_SEEN = 10_000
"""So many ids are remembered, for the audit."""
TOLD_EVERY_S = 60.0
"""So often an event says that something of a kind was refused; the audit has each."""

_RETAINED = "the {} was retained, so that nobody knows when it was given; publish it without"

_log = logging.getLogger("drivecomm.server")


class Commanding:
    """Hears commands, has them carried out and answers. keeps_old: the broker may send what it has kept from before."""

    def __init__(self, plant: ServedPlant, topics: Topics, callers: BrokerCallers, *, keeps_old: bool) -> None:
        self._plant, self._topics, self._callers, self._keeps_old = plant, topics, callers, keeps_old
        self.session = ""
        """The word of this connection; empty while there is none."""
        self._connection: Connection | None = None
        self._doing: set[asyncio.Task[None]] = set()
        self._stopping: set[asyncio.Task[None]] = set()
        self._stops = Stops(self._begin_stop)
        self._commands = 0
        self._told_s: dict[str, float] = {}
        self._seen: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._kinds: dict[str, tuple[str, Callable[[str, Received], Coroutine[Any, Any, None]]]] = {
            "command": (topics.of_all("command"), self._command),
            "stop": (topics.of_all("stop"), self._stop),
            "request": (f"{topics.bridge}/request/#", self._request),
        }
        self._stop_all = f"{topics.bridge}/request/stop"
        self._rates = {kind: Flood() for kind in self._kinds}
        self._flooded = asyncio.Event()

    @property
    def listens(self) -> bool:
        """Whether anybody could command anything here."""
        return self._callers.listens

    async def begin(self, connection: Connection) -> None:
        """Listen on a new connection, under a session of its own."""
        self.session, self._connection = secrets.token_urlsafe(9), connection
        if self.listens:
            await connection.subscribe(*(topic for topic, _ in self._kinds.values()))

    def end(self) -> None:
        """Take no more: the connection is lost. What was begun is carried out, and every stop that has come."""
        self.session, self._connection = "", None
        for task in self._doing:
            task.cancel()

    async def guard(self, connection: Connection) -> None:
        """Not listen to a flood, until the connection is lost."""
        pausing: set[asyncio.Task[None]] = set()
        try:
            while True:
                await self._flooded.wait()
                self._flooded.clear()
                flooded = [kind for kind, rate in self._rates.items() if rate.refused]
                for kind in flooded:
                    if not any(task.get_name() == kind for task in pausing):
                        task = asyncio.create_task(self._pause(connection, kind), name=kind)
                        pausing.add(task)
                        task.add_done_callback(pausing.discard)
        finally:
            for task in pausing:
                task.cancel()
            await asyncio.gather(*pausing, return_exceptions=True)

    async def _pause(self, connection: Connection, kind: str) -> None:
        topic = self._kinds[kind][0]
        with suppress(LinkError):
            if kind == "request":
                # A stop of everything is heard all the time.
                await connection.subscribe(self._stop_all)
            await connection.unsubscribe(topic)
            self._tell(f"too many messages come to {topic}: nothing is listened to there for {PAUSE_S:g} s", kind)
            await asyncio.sleep(PAUSE_S)
            why = f"{self._rates[kind].taken()} messages to {topic} were thrown away: they came too fast"
            await connection.subscribe(topic)
            if kind == "request":
                await connection.unsubscribe(self._stop_all)
            self._plant.refuse(self._callers.unknown, Command(drive="", verb=kind), why)

    def received(self, received: Received) -> None:
        """Hear a message; the rest is done later."""
        kind, what = self._meant(received)
        if kind not in self._kinds or self._connection is None:
            return
        if not received.payload and kind == "command":
            # How a retained message is cleared.
            return
        if kind == "stop" or received.topic == self._stop_all:
            self._take_stop(received)
            return
        if not self._admits(kind):
            self._flooded.set()
            return
        self._begin(kind, what, received, self._doing)

    def _meant(self, received: Received) -> tuple[str, str]:
        """Return the kind of a message, and its drive or what is asked for."""
        requests = f"{self._topics.bridge}/request/"
        if received.topic.startswith(requests):
            return "request", name_of(received.topic.removeprefix(requests))
        if received.topic.startswith(f"{self._topics.bridge}/"):
            # Such as our own answer to a stop of everything, where lines are a level.
            return "", ""
        *_, drive, kind = received.topic.split("/")
        return kind, name_of(drive)

    def _admits(self, kind: str) -> bool:
        return self._rates[kind].admits(time.monotonic(), len(self._plant.plant.drives))

    def _begin(self, kind: str, what: str, received: Received, tasks: set[asyncio.Task[None]]) -> None:
        task = asyncio.create_task(self._heard(kind, what, received), name=f"mqtt {kind}")
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    def _take_stop(self, received: Received) -> None:
        """Carry out a stop; of a flood the latest of each drive, in its turn, and nothing that is none."""
        if not self._stops.wait and self._admits("stop"):
            self._begin_stop(received)
            return
        with suppress(DriveCommError):
            if self._stops.put(self._stopped_by(received), received):
                return
        self._tell(f"too many messages come to {received.topic} that stop nothing: they are thrown away", "stop")

    def _begin_stop(self, received: Received) -> None:
        # Not among those that end with the connection: one that has come goes out.
        self._begin(*self._meant(received), received, self._stopping)

    def _stopped_by(self, received: Received) -> tuple[str, ...]:
        """Return what a stop is for. Raises UsageError and NotAllowedError for one that would be refused."""
        kind, what = self._meant(received)
        content = stopped(received.payload) if kind == "stop" else requested(what, received.payload)
        self._callers.of(content)
        self._check_stop(received)
        if kind == "stop":
            self._plant.drive(what)
        return kind, what, *sorted(content.get("lines", ()))

    async def _heard(self, kind: str, what: str, received: Received) -> None:
        try:
            await self._kinds[kind][1](what, received)
        except LinkError:
            # Whoever asked finds that out by the same loss, and by the audit what was done.
            pass
        except Exception:  # noqa: BLE001 - a message that we cannot handle costs the others nothing
            _log.exception("message on %s", received.topic)

    async def _command(self, drive: str, received: Received) -> None:
        content: dict[str, Any] = {}
        caller = self._callers.unknown
        try:
            content = commanded(received.payload)
            caller = self._callers.of(content)
            self._check_topic(drive, received)
            self._check_now(content, received)
            if content.get("verb") != "stop" and self._commands >= MOST_AT_ONCE:
                raise NotAllowedError(f"{MOST_AT_ONCE} commands are under way; ask again when some of them are done")
        except DriveCommError as error:
            command = replace(command_of(drive, content), verb=content.get("verb", "") or "command")
            await self._refused(caller, command, error, received)
            return
        command = command_of(drive, content)
        if command.verb == "stop":
            await self._carried_out(caller, command, received)
            return
        asks = command.verb in NEEDS and not NEEDS[command.verb].commands
        if not asks and self._is_repeated(caller, command):
            # Nothing is done again, and whoever asks gets the first answer again.
            self._plant.refuse(caller, command, "the same command came again; nothing was done for it")
        self._commands += 1
        try:
            await self._carried_out(caller, command, received)
        finally:
            self._commands -= 1

    def _is_repeated(self, caller: Caller, command: Command) -> bool:
        key = caller.name, command.id
        repeated = bool(command.id) and key in self._seen
        self._seen[key] = None
        while len(self._seen) > _SEEN:
            self._seen.popitem(last=False)
        return repeated

    def _check_topic(self, drive: str, received: Received) -> None:
        """Raise UsageError for the topic of a drive on a line that is not its own; a stop there stops it anyway."""
        own = self._topics.command(drive)
        if received.topic != own and any(each.name == drive for each in self._plant.plant.drives):
            raise UsageError(f"{received.topic} is not where {drive} is commanded; publish to {own}")

    def _check_now(self, content: dict[str, Any], received: Received) -> None:
        """Raise NotAllowedError and UsageError for what is not known to be meant for now."""
        if received.retained:
            raise NotAllowedError(_RETAINED.format("command"))
        if content.get("verb") == "stop":
            return
        if missing := why_incomplete(content):
            raise UsageError(missing)
        if content.get("session", self.session) != self.session:
            raise NotAllowedError(
                f"the command was meant for an earlier connection; read the session again in {self._topics.state}"
            )

    async def _stop(self, drive: str, received: Received) -> None:
        caller, command = self._callers.unknown, Command(drive=drive, verb="stop")
        try:
            content = stopped(received.payload)
            command = replace(command, id=content.get("id", ""), arguments=_how(content))
            caller = self._callers.of(content)
            self._check_stop(received)
        except DriveCommError as error:
            await self._refused(caller, command, error, received)
            return
        await self._carried_out(caller, command, received)

    def _check_stop(self, received: Received) -> None:
        """Raise NotAllowedError for a stop of another time, which would come with each connection.

        Where the broker sends nothing that it has kept, one that is marked was given just now.
        """
        if received.retained and self._keeps_old:
            raise NotAllowedError(_RETAINED.format("stop"))

    async def _carried_out(self, caller: Caller, command: Command, received: Received) -> None:
        answer = await self._plant.command(caller, command)
        if received.retained:
            self._tell(f"a stop of {command.drive} was published as retained; publish it without", "retained stop")
        await self._answer(command, answer, received)

    async def _refused(self, caller: Caller, command: Command, error: DriveCommError, received: Received) -> None:
        self._plant.refuse(caller, command, in_one_line(error))
        if received.retained:
            self._tell(
                f"a retained command came to {received.topic} and was refused; clear it with an empty retained message",
                "retained",
            )
        await self._answer(command, Answer(id=command.id, outcome="refused", error=error), received)

    async def _request(self, what: str, received: Received) -> None:
        content: dict[str, Any] = {}
        caller, answered = self._callers.unknown, {}
        try:
            content = requested(what, received.payload)
            caller = self._callers.of(content)
            if what == "stop":
                self._check_stop(received)
            else:
                self._check_now({"verb": "status", **content}, received)
            result = await carried_out(self._plant, caller, what, content)
            answered = {"outcome": "done", "result": result, "error": None}
        except DriveCommError as error:
            self._plant.refuse(caller, Command(drive=content.get("drive", ""), verb=what), in_one_line(error))
            answered = {"outcome": "refused", "result": None, "error": error_content(error)}
        topic = f"{self._topics.bridge}/response/{what}"
        await self._publish(topic, {"id": content.get("id", ""), **answered}, received)

    async def _answer(self, command: Command, answer: Answer, received: Received) -> None:
        told = {
            "id": answer.id,
            "verb": command.verb,
            "outcome": answer.outcome,
            "result": plain(answer.result),
            "error": None if answer.error is None else error_content(answer.error),
        }
        await self._publish(f"{received.topic.rpartition('/')[0]}/response", told, received)

    async def _publish(self, topic: str, content: dict[str, Any], received: Received) -> None:
        if self._connection is None:
            return
        wanted = received if self._may_answer_at(received.answer_to) else replace(received, answer_to="")
        await self._connection.answer(wanted, Message(topic=topic, payload=json_text(content)))

    def _may_answer_at(self, topic: str) -> bool:
        """Whether an answer may go where a message wants it: not into our own topics, or into what the system has."""
        fit = topic.isprintable() and not set(topic) & set("+#") and not topic.startswith("$")
        return bool(topic) and fit and not topic.startswith(f"{self._topics.prefix}/")

    def _tell(self, text: str, kind: str) -> None:
        now = time.monotonic()
        if now - self._told_s.get(kind, -TOLD_EVERY_S) >= TOLD_EVERY_S:
            self._told_s[kind] = now
            self._plant.tell(text, who=self._callers.door)


def _how(content: dict[str, Any]) -> dict[str, Any]:
    return {"how": content["how"]} if "how" in content else {}
