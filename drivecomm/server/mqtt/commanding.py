"""Commands over a broker: commands that may be old, replayed or forged are refused; stops are always sent.

A broker can retain, queue and repeat messages. So a command names the session of this connection, which changes with
each connection. It also has an id, its issue time and the duration of its validity. Retained commands are always
refused.
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
from drivecomm.server import NEEDS, CommandAnswer, CommandRequest
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.command_parser import (
    command_of,
    parse_command,
    parse_plant_request,
    parse_stop,
    why_incomplete,
)
from drivecomm.server.mqtt.rate_limit import PAUSE_S, RateLimit
from drivecomm.server.mqtt.requests import carry_out_request
from drivecomm.server.mqtt.stops import Stops
from drivecomm.server.mqtt.topics import name_of

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from drivecomm.server import Caller, ServedPlant
    from drivecomm.server.broker import BrokerConnection, ReceivedMessage
    from drivecomm.server.mqtt.callers import BrokerCallers
    from drivecomm.server.mqtt.topics import Topics

MOST_AT_ONCE = 50
"""Maximum number of commands in progress, stops not counted."""
_SEEN = 10_000
"""Number of ids remembered to detect repeated commands in the audit."""
TOLD_EVERY_S = 60.0
"""Shortest interval in seconds between events about refusals of one kind; the audit records each refusal."""

_RETAINED = "the {} was retained, so its time is unknown; publish it without the retain flag"

_log = logging.getLogger("drivecomm.server")


class Commanding:
    """Receiver of commands: carries them out and publishes the answers.

    keeps_old: whether the broker may send messages that it has retained from earlier.
    """

    def __init__(self, plant: ServedPlant, topics: Topics, callers: BrokerCallers, *, keeps_old: bool) -> None:
        self._plant, self._topics, self._callers, self._keeps_old = plant, topics, callers, keeps_old
        self.session = ""
        """Session of this connection, "" while disconnected."""
        self._connection: BrokerConnection | None = None
        self._doing: set[asyncio.Task[None]] = set()
        self._stopping: set[asyncio.Task[None]] = set()
        self._stops = Stops(self._begin_stop)
        self._commands = 0
        self._told_s: dict[str, float] = {}
        self._seen: OrderedDict[tuple[str, str], None] = OrderedDict()
        self._kinds: dict[str, tuple[str, Callable[[str, ReceivedMessage], Coroutine[Any, Any, None]]]] = {
            "command": (topics.of_all("command"), self._command),
            "stop": (topics.of_all("stop"), self._stop),
            "request": (f"{topics.bridge}/request/#", self._request),
        }
        self._stop_all = f"{topics.bridge}/request/stop"
        self._rates = {kind: RateLimit() for kind in self._kinds}
        self._flooded = asyncio.Event()

    @property
    def listens(self) -> bool:
        """Whether any caller may command here."""
        return self._callers.listens

    async def begin(self, connection: BrokerConnection) -> None:
        """Subscribe on a new connection, with a new session."""
        self.session, self._connection = secrets.token_urlsafe(9), connection
        if self.listens:
            await connection.subscribe(*(topic for topic, _ in self._kinds.values()))

    def end(self) -> None:
        """Stop accepting messages after a lost connection. Tasks of commands are cancelled, those of stops are not."""
        self.session, self._connection = "", None
        for task in self._doing:
            task.cancel()

    async def guard(self, connection: BrokerConnection) -> None:
        """Unsubscribe from flooded topics for a while, until the connection is lost."""
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

    async def _pause(self, connection: BrokerConnection, kind: str) -> None:
        topic = self._kinds[kind][0]
        with suppress(LinkError):
            if kind == "request":
                # The topic that stops everything stays subscribed.
                await connection.subscribe(self._stop_all)
            await connection.unsubscribe(topic)
            self._tell(f"too many messages arrive at {topic}: ignoring that topic for {PAUSE_S:g} s", kind)
            await asyncio.sleep(PAUSE_S)
            why = f"{self._rates[kind].taken()} messages to {topic} were discarded, because they arrived too fast"
            await connection.subscribe(topic)
            if kind == "request":
                await connection.unsubscribe(self._stop_all)
            self._plant.refuse(self._callers.unknown, CommandRequest(drive="", verb=kind), why)

    def received(self, received: ReceivedMessage) -> None:
        """Accept a message, to be processed in a task."""
        kind, what = self._meant(received)
        if kind not in self._kinds or self._connection is None:
            return
        if not received.payload and kind == "command":
            # An empty message only clears a retained one.
            return
        if kind == "stop" or received.topic == self._stop_all:
            self._take_stop(received)
            return
        if not self._admits(kind):
            self._flooded.set()
            return
        self._begin(kind, what, received, self._doing)

    def _meant(self, received: ReceivedMessage) -> tuple[str, str]:
        """Return the kind of a message, and its drive or the name of its request."""
        requests = f"{self._topics.bridge}/request/"
        if received.topic.startswith(requests):
            return "request", name_of(received.topic.removeprefix(requests))
        if received.topic.startswith(f"{self._topics.bridge}/"):
            # For example our own answer to a stop of everything, if lines are a level.
            return "", ""
        *_, drive, kind = received.topic.split("/")
        return kind, name_of(drive)

    def _admits(self, kind: str) -> bool:
        return self._rates[kind].admits(time.monotonic(), len(self._plant.plant.drives))

    def _begin(self, kind: str, what: str, received: ReceivedMessage, tasks: set[asyncio.Task[None]]) -> None:
        task = asyncio.create_task(self._heard(kind, what, received), name=f"mqtt {kind}")
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    def _take_stop(self, received: ReceivedMessage) -> None:
        """Carry out a stop. In a flood, queue the latest stop of each drive and drop invalid ones."""
        if not self._stops.wait and self._admits("stop"):
            self._begin_stop(received)
            return
        with suppress(DriveCommError):
            if self._stops.put(self._stopped_by(received), received):
                return
        self._tell(f"too many messages arrive at {received.topic} that are not stops: they are discarded", "stop")

    def _begin_stop(self, received: ReceivedMessage) -> None:
        # Not among the tasks cancelled with the connection: a received stop must be sent.
        self._begin(*self._meant(received), received, self._stopping)

    def _stopped_by(self, received: ReceivedMessage) -> tuple[str, ...]:
        """Return a key for the target of a stop. Raises UsageError and NotAllowedError if it would be refused."""
        kind, what = self._meant(received)
        content = parse_stop(received.payload) if kind == "stop" else parse_plant_request(what, received.payload)
        self._callers.of(content)
        self._check_stop(received)
        if kind == "stop":
            self._plant.drive(what)
        return kind, what, *sorted(content.get("lines", ()))

    async def _heard(self, kind: str, what: str, received: ReceivedMessage) -> None:
        try:
            await self._kinds[kind][1](what, received)
        except LinkError:
            # The caller notices the lost connection as well, and the audit has the result.
            pass
        except Exception:  # noqa: BLE001 - a message that we cannot handle costs the others nothing
            _log.exception("message on %s", received.topic)

    async def _command(self, drive: str, received: ReceivedMessage) -> None:
        content: dict[str, Any] = {}
        caller = self._callers.unknown
        try:
            content = parse_command(received.payload)
            caller = self._callers.of(content)
            self._check_topic(drive, received)
            self._check_now(content, received)
            if content.get("verb") != "stop" and self._commands >= MOST_AT_ONCE:
                raise NotAllowedError(f"{MOST_AT_ONCE} commands are under way; try again when some of them are done")
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
            # The plant does not repeat the command; it returns the first answer again.
            self._plant.refuse(caller, command, "the same command arrived again and was ignored")
        self._commands += 1
        try:
            await self._carried_out(caller, command, received)
        finally:
            self._commands -= 1

    def _is_repeated(self, caller: Caller, command: CommandRequest) -> bool:
        key = caller.name, command.id
        repeated = bool(command.id) and key in self._seen
        self._seen[key] = None
        while len(self._seen) > _SEEN:
            self._seen.popitem(last=False)
        return repeated

    def _check_topic(self, drive: str, received: ReceivedMessage) -> None:
        """Raise UsageError for a command below the wrong line. A stop there is still carried out."""
        own = self._topics.command(drive)
        if received.topic != own and any(each.name == drive for each in self._plant.plant.drives):
            raise UsageError(f"{received.topic} is not the command topic of {drive}; publish to {own}")

    def _check_now(self, content: dict[str, Any], received: ReceivedMessage) -> None:
        """Raise NotAllowedError or UsageError for a command that may be meant for another time."""
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

    async def _stop(self, drive: str, received: ReceivedMessage) -> None:
        caller, command = self._callers.unknown, CommandRequest(drive=drive, verb="stop")
        try:
            content = parse_stop(received.payload)
            command = replace(command, id=content.get("id", ""), arguments=_how(content))
            caller = self._callers.of(content)
            self._check_stop(received)
        except DriveCommError as error:
            await self._refused(caller, command, error, received)
            return
        await self._carried_out(caller, command, received)

    def _check_stop(self, received: ReceivedMessage) -> None:
        """Raise NotAllowedError for a stored stop, which the broker would send again on every connection.

        If the broker sends no stored messages, a message with the retain flag is live.
        """
        if received.retained and self._keeps_old:
            raise NotAllowedError(_RETAINED.format("stop"))

    async def _carried_out(self, caller: Caller, command: CommandRequest, received: ReceivedMessage) -> None:
        answer = await self._plant.command(caller, command)
        if received.retained:
            self._tell(f"a stop of {command.drive} was published as retained; publish it without", "retained stop")
        await self._answer(command, answer, received)

    async def _refused(
        self, caller: Caller, command: CommandRequest, error: DriveCommError, received: ReceivedMessage
    ) -> None:
        self._plant.refuse(caller, command, in_one_line(error))
        if received.retained:
            self._tell(
                f"a retained command came to {received.topic} and was refused; clear it with an empty retained message",
                "retained",
            )
        await self._answer(command, CommandAnswer(id=command.id, outcome="refused", error=error), received)

    async def _request(self, what: str, received: ReceivedMessage) -> None:
        content: dict[str, Any] = {}
        caller, answered = self._callers.unknown, {}
        try:
            content = parse_plant_request(what, received.payload)
            caller = self._callers.of(content)
            if what == "stop":
                self._check_stop(received)
            else:
                self._check_now({"verb": "status", **content}, received)
            result = await carry_out_request(self._plant, caller, what, content)
            answered = {"outcome": "done", "result": result, "error": None}
        except DriveCommError as error:
            self._plant.refuse(caller, CommandRequest(drive=content.get("drive", ""), verb=what), in_one_line(error))
            answered = {"outcome": "refused", "result": None, "error": error_content(error)}
        topic = f"{self._topics.bridge}/response/{what}"
        await self._publish(topic, {"id": content.get("id", ""), **answered}, received)

    async def _answer(self, command: CommandRequest, answer: CommandAnswer, received: ReceivedMessage) -> None:
        told = {
            "id": answer.id,
            "verb": command.verb,
            "outcome": answer.outcome,
            "result": plain(answer.result),
            "error": None if answer.error is None else error_content(answer.error),
        }
        await self._publish(f"{received.topic.rpartition('/')[0]}/response", told, received)

    async def _publish(self, topic: str, content: dict[str, Any], received: ReceivedMessage) -> None:
        if self._connection is None:
            return
        wanted = received if self._may_answer_at(received.answer_to) else replace(received, answer_to="")
        await self._connection.answer(wanted, BrokerMessage(topic=topic, payload=json_text(content)))

    def _may_answer_at(self, topic: str) -> bool:
        """Whether an answer may go to the topic a message names: not to a topic of this plant or of the broker."""
        fit = topic.isprintable() and not set(topic) & set("+#") and not topic.startswith("$")
        return bool(topic) and fit and not topic.startswith(f"{self._topics.prefix}/")

    def _tell(self, text: str, kind: str) -> None:
        now = time.monotonic()
        if now - self._told_s.get(kind, -TOLD_EVERY_S) >= TOLD_EVERY_S:
            self._told_s[kind] = now
            self._plant.tell(text, who=self._callers.door)


def _how(content: dict[str, Any]) -> dict[str, Any]:
    return {"how": content["how"]} if "how" in content else {}
