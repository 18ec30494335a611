"""Live publication of values, events and drive states, retained for later subscribers."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.client import json_text, plain
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.batching import DriveBatches
from drivecomm.server.mqtt.content import repeated, sample_of, value_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.server import DriveDrift, Event, ServedPlant, StandingStop
    from drivecomm.server.broker import BrokerConnection
    from drivecomm.server.mqtt.changes import ChangeDetector
    from drivecomm.server.mqtt.content import PublishedValue
    from drivecomm.server.mqtt.delivered import LiveValues
    from drivecomm.server.mqtt.topics import Topics

Messages: TypeAlias = Literal["quantities", "drives"]
"""Layout of values: one topic per quantity, or one topic per drive, which causes less load."""

_LOOKED_EVERY_S = 0.05
AVAILABILITY_S = 0.5
"""Seconds between checks of reachability, drift and alarms."""
ONLINE, OFFLINE = '{"state":"online"}', '{"state":"offline"}'


class ValuePublisher:
    """Publisher of live data.

    live: records what the broker has received. changes: change filter; None if every poll is published. tell: records
    an event.
    """

    def __init__(
        self,
        plant: ServedPlant,
        topics: Topics,
        messages: Messages,
        live: LiveValues,
        *,
        changes: ChangeDetector | None = None,
        tell: Callable[[str], None],
    ) -> None:
        self._plant, self._topics, self._messages, self._live, self._tell = plant, topics, messages, live, tell
        self._changes = changes
        # Time in ms of the last value of each quantity that this run has delivered.
        self._has: dict[tuple[str, str], int] = {}
        # Last published JSON of each value, for the layout with one message per drive.
        self._texts: dict[str, dict[str, str]] = {}
        self._gathering = DriveBatches()
        self._event = 0
        self._available: dict[str, str | None] = {}
        self._drifts: dict[str, DriveDrift] = {}

    async def run(self, connection: BrokerConnection) -> None:
        """Publish all current data, then changes, until the connection is lost."""
        changes = self._plant.changes(0.0 if self._messages == "quantities" else _LOOKED_EVERY_S)
        lost = 0
        try:
            # The broker may have lost its retained messages.
            self._available, self._drifts = dict.fromkeys(self._available), {}
            await self._give_events(connection, self._plant.events(), historical=bool(self._event))
            await self._give(connection, [sample_of(each) for each in self._plant.values()])
            async for values, events in changes:
                news = [sample_of(each) for each in values]
                await self._give_events(connection, events)
                if changes.lost > lost:
                    self._tell(f"{changes.lost - lost} events were not published, because the broker is too slow")
                    lost = changes.lost
                for turn in self._turns([each for each in news if not self._is_known(each) and self._is_worth(each)]):
                    await self._give(connection, turn)
        finally:
            changes.close()

    async def gathered(self, connection: BrokerConnection) -> None:
        """Publish batched values when they are due, until the connection is lost."""
        while True:
            for turn in self._turns([]):
                await self._give(connection, turn)
            await asyncio.sleep(_LOOKED_EVERY_S)

    async def availability(self, connection: BrokerConnection) -> None:
        """Publish reachability, drift, standing stops and active alarms until the connection is lost."""
        standing: str | None = None
        while True:
            answering, stops = self._plant.answering(), self._plant.standing_stops()
            drives = self._plant.plant.drives
            now = {
                self._topics.availability(drive.name): _availability(
                    stops.get(drive.name), answers=drive.name in answering
                )
                for drive in drives
            }
            news = [
                BrokerMessage(topic=topic, payload=payload, retain=True)
                for topic, payload in now.items()
                if self._available.get(topic) != payload
            ]
            known = self._plant.drifts()
            drifts = {self._topics.drift(each.name): known[each.name] for each in drives if each.name in known}
            news += [
                BrokerMessage(topic=topic, payload=_drift(drift), retain=True)
                for topic, drift in drifts.items()
                if self._drifts.get(topic) is not drift
            ]
            if (alarms := json_text({"alarms": plain(self._plant.alarms())})) != standing:
                news.append(BrokerMessage(topic=self._topics.alarms, payload=alarms, retain=True))
            await _published(connection, news)
            standing, self._available, self._drifts = alarms, dict(now), drifts
            self._forget()
            await asyncio.sleep(AVAILABILITY_S)

    def _turns(self, news: Sequence[PublishedValue]) -> Sequence[Sequence[PublishedValue]]:
        """Return the samples to publish now, in rounds of one message per topic."""
        if self._messages == "quantities":
            return [news]
        self._gathering.add(news)
        return self._gathering.due(time.monotonic())

    def _forget(self) -> None:
        """Drop values that are no longer in the plant, so that later messages do not contain them."""
        there = {(value.drive, value.name) for value in self._plant.values()}
        self._has = {key: time_ms for key, time_ms in self._has.items() if key in there}
        self._texts = {
            drive: {name: text for name, text in texts.items() if (drive, name) in there}
            for drive, texts in self._texts.items()
        }

    async def _give(self, connection: BrokerConnection, samples: Sequence[PublishedValue]) -> None:
        """Publish samples concurrently and wait until the broker has acknowledged all."""
        sent = [(await connection.hand_over(message), news) for message, news in self._as_messages(samples)]
        for message, news in sent:
            await message.arrived()
            for sample in news:
                self._take_note(sample)
                if self._changes is not None:
                    self._changes.published(sample)

    def _is_worth(self, sample: PublishedValue) -> bool:
        """Return whether to publish a new sample. An unchanged one is recorded as delivered."""
        if self._changes is None or self._changes.is_change(sample):
            return True
        self._take_note(sample)
        return False

    def _take_note(self, sample: PublishedValue) -> None:
        self._has[sample.drive, sample.name] = sample.time_ms
        self._live.add(sample)

    def _is_known(self, sample: PublishedValue) -> bool:
        return self._has.get((sample.drive, sample.name)) == sample.time_ms

    def _as_messages(
        self, samples: Sequence[PublishedValue]
    ) -> Iterable[tuple[BrokerMessage, Sequence[PublishedValue]]]:
        if self._messages == "quantities":
            for sample in samples:
                topic, text, is_known = (
                    self._topics.value(sample.drive, sample.name),
                    value_text(sample),
                    self._is_known(sample),
                )
                payload = repeated(text) if is_known else text
                yield BrokerMessage(topic=topic, payload=payload, retain=True), [] if is_known else [sample]
            return
        by_drive: dict[str, list[PublishedValue]] = {}
        for sample in samples:
            by_drive.setdefault(sample.drive, []).append(sample)
        for drive, its in by_drive.items():
            known = self._texts.setdefault(drive, {})
            told = {sample.name: value_text(sample) for sample in its}
            news = [sample for sample in its if not self._is_known(sample)]
            known |= {name: repeated(text) for name, text in told.items()}
            now = known | {sample.name: told[sample.name] for sample in news}
            inside = ",".join(f"{json_text(name)}:{text}" for name, text in now.items())
            yield BrokerMessage(topic=self._topics.values(drive), payload=f"{{{inside}}}", retain=True), news

    async def _give_events(
        self, connection: BrokerConnection, events: Sequence[Event], *, historical: bool = False
    ) -> None:
        for event in events:
            if event.number > self._event:
                content = plain(event) | ({"historical": True} if historical else {})
                await connection.publish(BrokerMessage(topic=self._topics.event, payload=json_text(content)))
                self._event = event.number
                self._live.add_event(event)


def _availability(stop: StandingStop | None, *, answers: bool) -> str:
    state = ONLINE if answers else OFFLINE
    return state if stop is None else f'{state[:-1]},"standing_stop":{json_text(str(stop))}}}'


def _drift(drift: DriveDrift) -> str:
    content = {"state": drift.state, "changed": drift.changed, "since_s": drift.since_s}
    return json_text({**content, "text": str(drift)})


async def _published(connection: BrokerConnection, messages: Iterable[BrokerMessage]) -> None:
    await asyncio.gather(*(connection.publish(each) for each in messages))
