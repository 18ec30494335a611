"""The service of the MQTT door on its broker, across reconnections."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivecomm.server import run_concurrently
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.callers import BrokerCallers
from drivecomm.server.mqtt.changes import ChangeDetector, tag_deadband
from drivecomm.server.mqtt.commanding import Commanding
from drivecomm.server.mqtt.delivered import LiveValues
from drivecomm.server.mqtt.discovery_publisher import DiscoveryPublisher
from drivecomm.server.mqtt.event_backfill import EventBackfill
from drivecomm.server.mqtt.home_assistant import Discovery
from drivecomm.server.mqtt.value_backfill import ValueBackfill
from drivecomm.server.mqtt.value_publisher import OFFLINE, ValuePublisher

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.server import ServedPlant
    from drivecomm.server.broker import BrokerConnection, ReceivedMessage
    from drivecomm.server.mqtt.settings import MqttSettings
    from drivecomm.server.mqtt.topics import Topics

_BEGUN = b"online"
"""Payload that Home Assistant publishes on its status topic after a start."""


class Publishing:
    """Publication of a plant on a broker.

    name: name of the door. file: stores the position in the history between runs.
    """

    def __init__(self, plant: ServedPlant, topics: Topics, settings: MqttSettings, *, name: str, file: Path) -> None:
        self._topics, self._messages = topics, settings.messages
        callers = BrokerCallers(users=plant.users, door=name, role=settings.role)
        values = LiveValues()
        prefix = settings.home_assistant
        stays_s = settings.changes.at_least_every_s if settings.changes else 0.0
        area = settings.levels.get("area", plant.name)
        discovery = Discovery(prefix, topics, settings.messages, area, stays_s=stays_s) if prefix else None
        self._begun_topic = f"{prefix}/status" if prefix else ""
        self._telling = DiscoveryPublisher(plant, topics, callers.everybody, discovery)
        self._commanding = Commanding(plant, topics, callers, keeps_old=settings.broker.version != "5")
        tell = partial(plant.tell, who=name)
        rules, new_changes = settings.changes, None
        if rules is not None:
            new_changes = partial(ChangeDetector, rules, partial(tag_deadband, plant))
        changes = None if new_changes is None else new_changes()
        self._live = ValuePublisher(plant, topics, settings.messages, values, changes=changes, tell=tell)
        history, historical = plant.history, topics.historical
        self.catching_up = (
            None
            if history is None
            else ValueBackfill(history, values, historical, file, new_changes=new_changes, tell=tell)
        )
        happened = file.with_name(f"happened-{file.name}")
        self._happened = None if history is None else EventBackfill(history, values, topics, happened, tell=tell)

    async def begin(self) -> None:
        """Load the positions that the last run has saved."""
        if self.catching_up is not None:
            await self.catching_up.begin()
        if self._happened is not None:
            await self._happened.begin()

    async def end(self) -> None:
        """Save the position in the history."""
        if self.catching_up is not None:
            await self.catching_up.end()

    def will(self) -> BrokerMessage | None:
        """Return the message that the broker publishes if this gateway disappears."""
        return BrokerMessage(topic=self._topics.state, payload=OFFLINE, retain=True)

    async def farewell(self, connection: BrokerConnection) -> None:
        """Publish that this gateway goes offline."""
        await connection.publish(BrokerMessage(topic=self._topics.state, payload=OFFLINE, retain=True))

    async def serve(self, connection: BrokerConnection) -> None:
        """Serve a connection: live values first, missed values alongside."""
        try:
            await self._commanding.begin(connection)
            if self._begun_topic:
                await connection.subscribe(self._begun_topic)
            self._telling.session = self._commanding.session
            await self._telling.begin(connection, listens=self._commanding.listens)
            parts = [
                self._live.run(connection),
                self._live.availability(connection),
                self._telling.run(connection),
                self._commanding.guard(connection),
            ]
            if self._messages == "drives":
                parts.append(self._live.gathered(connection))
            if self.catching_up is not None:
                parts.append(self.catching_up.run(connection))
            if self._happened is not None:
                parts.append(self._happened.run(connection))
            await run_concurrently(*parts)
        finally:
            self._commanding.end()

    def received(self, received: ReceivedMessage) -> None:
        """Dispatch a message."""
        if received.topic == self._begun_topic:
            if received.payload == _BEGUN:
                self._telling.again()
            return
        if self._telling.received(received):
            return
        self._commanding.received(received)
