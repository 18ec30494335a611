"""Publication of the inventory: the gateway and its drives, at each connection and change, also to Home Assistant."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text
from drivecomm.line import STATUS
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.retained_state import AnnouncedDrive, RetainedInventory
from drivecomm.server.mqtt.topics import AVAILABILITY, DRIFT, VALUES, value_topic
from drivecomm.version import __version__

if TYPE_CHECKING:
    from drivecomm.server import Caller, CurrentValue, ServedPlant
    from drivecomm.server.broker import BrokerConnection, ReceivedMessage
    from drivecomm.server.mqtt.home_assistant import Discovery
    from drivecomm.server.mqtt.topics import Topics

LOOKED_EVERY_S = 1.0


class DiscoveryPublisher:
    """Publisher of the inventory. everybody: caller without a token. discovery: None without Home Assistant."""

    def __init__(self, plant: ServedPlant, topics: Topics, everybody: Caller, discovery: Discovery | None) -> None:
        self._plant, self._topics, self._everybody, self._discovery = plant, topics, everybody, discovery
        self._told: dict[str, str] = {}
        self._again = asyncio.Event()
        self._earlier = RetainedInventory(topics.info, topics.prefix)
        # Drives that the broker has from this run or an earlier one; None until it has been read back.
        self._has: dict[str, AnnouncedDrive] | None = None
        self.session = ""

    def received(self, received: ReceivedMessage) -> bool:
        """Handle a message; return whether it belonged here."""
        if received.topic != self._earlier.topic:
            return False
        self._earlier.received(received)
        return True

    async def begin(self, connection: BrokerConnection, *, listens: bool) -> None:
        """Publish that the gateway is online, with the session for commands."""
        content = {
            "state": "online",
            "session": self.session,
            "commands": listens,
            "plant": self._plant.name,
            "version": __version__,
            "since_s": round(time.time(), 3),
        }
        await connection.publish(BrokerMessage(topic=self._topics.state, payload=json_text(content), retain=True))
        # The broker may have lost them, and the session has changed.
        self._told = dict.fromkeys(self._told, "")

    def again(self) -> None:
        """Publish everything to Home Assistant again, because it has restarted."""
        self._told = dict.fromkeys(self._told, "")
        self._again.set()

    async def run(self, connection: BrokerConnection) -> None:
        """Publish the inventory and its changes until the connection is lost."""
        known: object = None
        if self._has is None:
            self._has = await self._earlier.drives(connection)
            if self._discovery is not None:
                self._told.update(dict.fromkeys(map(self._discovery.topic, self._has), ""))
        while True:
            if (like := self._like()) == known and not self._again.is_set():
                await self._wait()
                continue
            known = like
            now = {message.topic: message for message in self._messages(self._has)}
            for topic in self._told.keys() - now.keys():
                await connection.publish(BrokerMessage(topic=topic, payload=b"", retain=True))
                del self._told[topic]
            for topic, message in now.items():
                if self._told.get(topic) != message.payload:
                    await connection.publish(message)
                    self._told[topic] = str(message.payload)
            for message in self._forgotten(self._has):
                await connection.publish(message)
            self._again.clear()
            await self._wait()

    async def _wait(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(LOOKED_EVERY_S):
                await self._again.wait()

    def _like(self) -> object:
        """Return a fingerprint of the inventory: differs if there is something new to publish."""
        there = frozenset((each.drive, each.name, each.reading and each.reading.unit) for each in self._plant.values())
        plant = self._plant.plant
        return plant, plant.read_s, there

    def _polled(self) -> dict[str, set[str]]:
        """Return the quantities of each drive in the plant file, including those not read yet."""
        return {
            drive.name: {STATUS, *(name for group in drive.poll for name in group.parameters)}
            for drive in self._plant.plant.drives
        }

    def _forgotten(self, has: dict[str, AnnouncedDrive]) -> list[BrokerMessage]:
        """Return messages that clear the topics of removed or moved drives and quantities."""
        polled, topics = self._polled(), []
        for drive, told in list(has.items()):
            now = AnnouncedDrive(self._topics.drive(drive), told.quantities & polled.get(drive, set()))
            moved = drive not in polled or told.topic != now.topic
            gone = told.quantities if moved else told.quantities - now.quantities
            topics += [value_topic(told.topic, name) for name in sorted(gone)]
            if moved:
                topics += [f"{told.topic}/{each}" for each in (AVAILABILITY, DRIFT, VALUES)]
            has[drive] = now
            if drive not in polled:
                del has[drive]
        return [BrokerMessage(topic=topic, payload=b"", retain=True) for topic in topics]

    def _messages(self, has: dict[str, AnnouncedDrive]) -> list[BrokerMessage]:
        polled = self._polled()
        values: dict[str, list[CurrentValue]] = {}
        for value in self._plant.values():
            values.setdefault(value.drive, []).append(value)
        drives = self._plant.drives()
        told: list[dict[str, Any]] = []
        messages: list[BrokerMessage] = []
        for drive in drives:
            its = values.get(drive.name, [])
            may = list(self._plant.may(self._everybody, drive.name)) if self._everybody.role else []
            told.append(
                {
                    "name": drive.name,
                    "title": drive.config.title,
                    "drive": str(drive.config),
                    "line": drive.line,
                    "model": str(drive.config.options.get("model") or ""),
                    "monitoring_only": drive.monitoring_only,
                    "topic": self._topics.drive(drive.name),
                    "quantities": [each.name for each in its],
                    "may": may,
                }
            )
            known = has.setdefault(drive.name, AnnouncedDrive(self._topics.drive(drive.name), set())).quantities
            if self._discovery is not None:
                gone = known - polled.get(drive.name, known)
                messages.append(self._discovery.told(drive, its, may, self.session, gone))
            known.update(each.name for each in its)
        plant = self._plant.plant
        file = {"name": Path(plant.file).name, "sha256": plant.sha256, "read_s": plant.read_s}
        info = {"plant": self._plant.name, "version": __version__, "file": file, "drives": told}
        return [BrokerMessage(topic=self._topics.info, payload=json_text(info), retain=True), *messages]
