"""The MQTT door as a `[[door]]` of a plant file makes it."""

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
    from drivecomm.server.mqtt.catching_up import CatchingUp
    from drivecomm.server.mqtt.settings import MqttSettings
    from drivecomm.tomlfile import Table


def mqtt_door(table: Table) -> MqttDoor:
    """Return the MQTT door that a table of the plant file describes.

    Raises FileFormatError, and UsageError where what it needs is not installed.
    """
    settings = mqtt_settings(table)
    try:
        # Here, and not in the door's thread beside those of the lines, which would wait for it.
        import aiomqtt  # noqa: F401 - only for plants with such a door

        from drivecomm.server.broker import Broker  # noqa: F401 - as above
        from drivecomm.server.mqtt import serving  # noqa: F401 - as above
    except ImportError as error:
        raise UsageError(f'the MQTT door needs more packages ({error}); say pip install "drivecomm[mqtt]"') from error
    return MqttDoor(settings)


class MqttDoor:
    """Publishes a plant on a broker."""

    loop_factory = asyncio.SelectorEventLoop
    """aiomqtt needs one that watches sockets, which the usual one of Windows does not."""

    def __init__(self, settings: MqttSettings) -> None:
        self.settings = settings
        self.broker: Broker | None = None
        """While it runs."""
        self._catching_up: CatchingUp | None = None

    @property
    def name(self) -> str:
        """How callers and events name it."""
        return f"mqtt {self.settings.broker.place}"

    def health(self) -> DoorHealth:
        """Return whether its broker is there, and how far the history is delivered."""
        return DoorHealth(
            up=self.broker is not None and self.broker.connected,
            delivered_row=None if self._catching_up is None else self._catching_up.row,
        )

    def address_of(self, plant: str, drive: DriveConfig, name: str) -> str:
        """Return the topic of a value, and the name of the value in its message where that has several."""
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
        """Serve until cancelled; a broker that is not there is waited for."""
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
