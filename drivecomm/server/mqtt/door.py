"""The MQTT door that a `[[door]]` of a plant file configures."""

from __future__ import annotations

import asyncio
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.server import LINE, DoorHealth, state_folder
from drivecomm.server.mqtt.settings import mqtt_settings
from drivecomm.server.mqtt.topics import Topics, level, line_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import DriveConfig
    from drivecomm.server import ServedPlant
    from drivecomm.server.broker import Broker
    from drivecomm.server.mqtt.settings import MqttSettings
    from drivecomm.server.mqtt.value_backfill import ValueBackfill
    from drivecomm.tomlfile import TomlTable


def mqtt_door(table: TomlTable) -> MqttDoor:
    """Return the MQTT door that a table of the plant file describes.

    Raises FileFormatError, or UsageError if a required package is not installed.
    """
    settings = mqtt_settings(table)
    try:
        # Imported here, because the import is slow in the door's thread while lines are busy.
        import aiomqtt  # noqa: F401 - only for plants with such a door

        from drivecomm.server.broker import Broker  # noqa: F401 - as above
        from drivecomm.server.mqtt import serving  # noqa: F401 - as above
    except ImportError as error:
        raise UsageError(f'the MQTT door needs more packages ({error}); run pip install "drivecomm[mqtt]"') from error
    return MqttDoor(settings)


class MqttDoor:
    """Publisher of a plant on a broker."""

    loop_factory = asyncio.SelectorEventLoop
    """aiomqtt needs an event loop that watches sockets; the default loop of Windows does not."""

    def __init__(self, settings: MqttSettings) -> None:
        self.settings = settings
        self.broker: Broker | None = None
        """None while the door does not run."""
        self._catching_up: ValueBackfill | None = None

    @property
    def name(self) -> str:
        """Name of the door in callers and events."""
        return f"mqtt {self.settings.broker.place}"

    def health(self) -> DoorHealth:
        """Return whether the broker is connected, and the row up to which the history is delivered."""
        return DoorHealth(
            up=self.broker is not None and self.broker.connected,
            delivered_row=None if self._catching_up is None else self._catching_up.row,
        )

    def address_of(self, plant: str, drive: DriveConfig, name: str) -> str:
        """Return the topic of a value, followed by its name if the message has several values."""
        topics = self._topics(plant, lambda _: drive.line)
        if self.settings.messages == "quantities":
            return topics.value(drive.name, name)
        return f"{topics.values(drive.name)} {name}"

    def _topics(self, plant: str, line: Callable[[str], str | None]) -> Topics:
        levels, prefix = self.settings.levels, self.settings.prefix
        above = [level(name) for each, name in levels.items() if each != LINE]
        if above:
            prefix = "/".join([prefix or "drivecomm", *above])
        prefix = prefix or f"drivecomm/{level(plant, frozenset())}"
        return Topics(prefix, line if LINE in levels else None)

    async def run(self, plant: ServedPlant, opened: Callable[[], None]) -> None:
        """Serve until cancelled; waits for a broker that cannot be reached."""
        from drivecomm.server.broker import Broker
        from drivecomm.server.mqtt.serving import Publishing

        topics = self._topics(plant.name, line_of(plant))
        kept = sha256(f"{self.settings.broker.place} {topics.prefix}".encode()).hexdigest()[:8]
        file = state_folder(Path(plant.plant.file)) / f"mqtt-{kept}.json"
        publishing = Publishing(plant, topics, self.settings, name=self.name, file=file)
        self.broker = Broker(
            self.settings.broker,
            publishing,
            topic=topics.bridge,
            client_id=topics.prefix.replace("/", "-"),
            tell=lambda text: plant.tell(text, who=self.name),
        )
        await publishing.begin()
        self._catching_up = publishing.catching_up
        try:
            await self.broker.run(opened)
        finally:
            await publishing.end()
