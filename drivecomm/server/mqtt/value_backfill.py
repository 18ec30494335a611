"""Late delivery of values that were not published live: in the order of the history, in large messages.

Live values are published alongside and come first.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from contextlib import aclosing
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.content import named_text, past_sample
from drivecomm.server.mqtt.delivered import LiveValues, Position, read_position, write_position

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable
    from pathlib import Path

    from drivecomm.server import PastValue, PlantHistory
    from drivecomm.server.broker import BrokerConnection
    from drivecomm.server.mqtt.changes import ChangeDetector
    from drivecomm.server.mqtt.content import PublishedValue

LOOKED_EVERY_S = 2.0
"""Seconds between passes over the history; newer rows may still be on their way to the broker as live values."""
WRITTEN_EVERY_S = 5.0
"""Seconds between saves of the position; a killed server publishes this much twice."""
VALUES_A_MESSAGE = 200
"""About 25 KB, which bounds the delay of live values."""
_IN_FLIGHT = 3
"""Messages in flight; the rest of the capacity is for live values."""
_SHARE = 0.5
"""Pause as a multiple of the time worked, for the lines and the other doors."""


class ValueBackfill:
    """Delivery of the history, behind the live values.

    file: stores the position between runs. new_changes: makes a new change filter; None if every poll is published.
    tell: called with the text of a problem.
    """

    def __init__(
        self,
        history: PlantHistory,
        live: LiveValues,
        topic: str,
        file: Path,
        *,
        new_changes: Callable[[], ChangeDetector] | None = None,
        tell: Callable[[str], None],
    ) -> None:
        self._history, self._live, self._topic, self._file, self._tell = history, live, topic, file, tell
        self._new_changes = new_changes
        self._changes: ChangeDetector | None = None
        self._position = Position(0, 0)
        self._written: Position | None = None
        self._written_s = 0.0
        # Set while a restarted history is read: rows up to this time were published from its predecessor.
        self._known_until_ms: int | None = None
        self._trouble = ""
        self.published = 0
        """Number of values published late."""

    @property
    def row(self) -> int:
        """Row of the history up to which the broker has everything."""
        return self._position.row

    async def begin(self) -> None:
        """Load the position of the last run; without one, start at the present end of the history."""
        kept = await asyncio.to_thread(read_position, self._file)
        if kept is None:
            self._position = Position(await self._last_row(), 0)
            await self._write()
            return
        self._position = self._written = kept
        if kept.row and not await self._is_there(kept):
            # A power cut lost the end of the history, or a damaged one was restarted: its rows have new numbers.
            self._position, self._known_until_ms = Position(0, kept.time_ms), kept.time_ms

    async def run(self, connection: BrokerConnection) -> None:
        """Publish missing values until the connection is lost."""
        # Rows in flight when the last connection was lost are read again.
        self._changes = None if self._new_changes is None else self._new_changes()
        # The latest rows may still be on their way as live values.
        horizon = 0
        while True:
            try:
                end = await self._last_row()
                if horizon > self._position.row:
                    await self._up_to(connection, horizon)
                horizon, self._trouble = end, ""
            except FileFormatError as error:
                # Reported only once; the writer of the history reports the details.
                if not self._trouble:
                    self._tell(f"missed values cannot be published: {error}; it is tried again")
                self._trouble = str(error)
            if time.monotonic() - self._written_s >= WRITTEN_EVERY_S:
                await self._write()
            await asyncio.sleep(LOOKED_EVERY_S)

    async def end(self) -> None:
        """Save the position."""
        await self._write()

    async def _last_row(self) -> int:
        try:
            return await self._history.last_row()
        except FileFormatError:
            # There is no history before the first value.
            return 0

    async def _is_there(self, position: Position) -> bool:
        try:
            async with aclosing(self._history.since(position.row - 1)) as pieces:
                async for piece in pieces:
                    return piece[0].row == position.row and round(piece[0].time_s * 1000) == position.time_ms
        except FileFormatError:
            pass
        return False

    async def _up_to(self, connection: BrokerConnection, horizon: int) -> None:
        async with aclosing(self._in_messages(horizon)) as messages:
            await self._publish(connection, messages)
        self._known_until_ms = None

    async def _publish(self, connection: BrokerConnection, messages: AsyncIterator[list[PastValue]]) -> None:
        sending: deque[tuple[Position, asyncio.Task[None] | None, int]] = deque()
        try:
            async for rows in messages:
                began = time.thread_time()
                missing = [sample for sample in map(past_sample, rows) if self._is_missing(sample.time_ms)]
                texts = [named_text(sample) for sample in missing if self._is_published(sample)]
                task = None
                if texts:
                    payload = (
                        f'{{"historical":true,"first_row":{rows[0].row},"last_row":{rows[-1].row},'
                        f'"values":[{",".join(texts)}]}}'
                    )
                    publishing = connection.publish(BrokerMessage(topic=self._topic, payload=payload))
                    task = asyncio.create_task(publishing, name="missed values")
                sending.append((Position(rows[-1].row, round(rows[-1].time_s * 1000)), task, len(texts)))
                while len(sending) > _IN_FLIGHT or (sending and sending[0][1] is None):
                    await self._sent(*sending.popleft())
                if time.monotonic() - self._written_s >= WRITTEN_EVERY_S:
                    await self._write()
                await asyncio.sleep((time.thread_time() - began) * _SHARE)
            while sending:
                await self._sent(*sending.popleft())
        finally:
            for _, task, _ in sending:
                if task is not None:
                    task.cancel()
            await asyncio.gather(*(task for _, task, _ in sending if task is not None), return_exceptions=True)

    def _is_published(self, sample: PublishedValue) -> bool:
        """Return whether to publish a row of the history. Call once per row, in the order of rows."""
        has_it = self._live.take(sample)
        if self._changes is None:
            return not has_it
        if not self._changes.is_change(sample):
            return False
        self._changes.published(sample)
        return not has_it

    def _is_missing(self, time_ms: int) -> bool:
        return self._known_until_ms is None or time_ms > self._known_until_ms

    async def _sent(self, position: Position, task: asyncio.Task[None] | None, values: int) -> None:
        if task is not None:
            await task
        self._position = position
        self.published += values

    async def _in_messages(self, horizon: int) -> AsyncGenerator[list[PastValue], None]:
        async with aclosing(self._history.since(self._position.row)) as pieces:
            async for piece in pieces:
                wanted = piece if piece[-1].row <= horizon else [each for each in piece if each.row <= horizon]
                for start in range(0, len(wanted), VALUES_A_MESSAGE):
                    yield list(wanted[start : start + VALUES_A_MESSAGE])
                if len(wanted) < len(piece):
                    return

    async def _write(self) -> None:
        self._written_s = time.monotonic()
        # Until a restarted history has been read to its end, its row numbers would mislead the next run.
        if self._position == self._written or self._known_until_ms is not None:
            return
        problem = await asyncio.to_thread(write_position, self._file, self._position)
        if problem and not self._trouble:
            self._tell(f"{problem}; after a restart, values are published again")
        self._trouble = problem
        if not problem:
            self._written = self._position
