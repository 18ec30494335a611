"""Late delivery of commands and missed events from the history, in its order, also after a crash."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.client import json_text, plain
from drivecomm.errors import FileFormatError
from drivecomm.server.broker import BrokerMessage
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivecomm.server import PlantHistory
    from drivecomm.server.broker import BrokerConnection
    from drivecomm.server.mqtt.delivered import LiveValues
    from drivecomm.server.mqtt.topics import Topics

LOOKED_EVERY_S = 2.0
"""Seconds between reads of the history; a newer event may still be on its way to the broker."""
_AT_ONCE = 100
_FORMAT = 1


class EventBackfill:
    """Delivery of the events and commands of a history, behind the live ones.

    live: events already delivered. file: stores the position between runs. tell: called with the text of a problem.
    """

    def __init__(
        self, history: PlantHistory, live: LiveValues, topics: Topics, file: Path, *, tell: Callable[[str], None]
    ) -> None:
        self._history, self._live, self._topics, self._file, self._tell = history, live, topics, file, tell
        self._event = self._command = 0
        self._trouble = ""

    async def begin(self) -> None:
        """Load the position of the last run; without one, start at the present end of the history."""
        last = await self._last_rows()
        found = last
        with suppress(OSError, ValueError, TypeError, KeyError):
            content = json.loads(await asyncio.to_thread(self._file.read_bytes))
            if content["format"] == _FORMAT:
                found = int(content["event"]), int(content["command"])
        # A restarted history counts its rows from the beginning.
        self._event, self._command = (row if row <= its else 0 for row, its in zip(found, last, strict=True))
        await self._write()

    async def run(self, connection: BrokerConnection) -> None:
        """Publish missing events and commands until the connection is lost."""
        # The latest events may still be on their way live.
        horizon = 0
        while True:
            try:
                end, _ = await self._last_rows()
                await self._publish(connection, horizon)
                horizon, self._trouble = end, ""
            except FileFormatError as error:
                self._complain(f"missed events cannot be published: {error}; it is tried again")
            await asyncio.sleep(LOOKED_EVERY_S)

    async def _publish(self, connection: BrokerConnection, horizon: int) -> None:
        while True:
            events, commands = await self._history.events_and_commands_since(self._event, self._command, _AT_ONCE)
            events = [each for each in events if each.row <= horizon]
            if not events and not commands:
                return
            for event in events:
                if not self._live.take_event(event.event):
                    content = {**plain(event.event), "historical": True}
                    await connection.publish(BrokerMessage(topic=self._topics.event, payload=json_text(content)))
                self._event = event.row
            if commands:
                content = {"commands": plain(commands)}
                await connection.publish(BrokerMessage(topic=self._topics.audit, payload=json_text(content)))
                self._command = commands[-1].row
            await self._write()

    async def _last_rows(self) -> tuple[int, int]:
        try:
            return await self._history.last_rows()
        except FileFormatError:
            # There is no history before the first value.
            return 0, 0

    async def _write(self) -> None:
        content = {"format": _FORMAT, "event": self._event, "command": self._command}
        try:
            await asyncio.to_thread(write_atomically, self._file, json.dumps(content) + "\n")
        except (FileFormatError, OSError) as error:
            self._complain(f"{error}; after a restart, events and commands are published again")

    def _complain(self, text: str) -> None:
        # The same problem is reported only once in a row.
        if text != self._trouble:
            self._tell(text)
        self._trouble = text
