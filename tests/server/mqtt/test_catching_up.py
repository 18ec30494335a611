"""Publishing of missed values after a time without a broker: every row once, in order, from the last position."""

import asyncio
from decimal import Decimal
from functools import partial

import pytest

from drivecomm.client import parsed
from drivecomm.errors import LinkDownError
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue, cancel_and_wait
from drivecomm.server.history import HistoryFile
from drivecomm.server.history_service import HistoryService
from drivecomm.server.mqtt import value_backfill
from drivecomm.server.mqtt.changes import ChangeDetector, ChangeRules
from drivecomm.server.mqtt.content import sample_of
from drivecomm.server.mqtt.delivered import LiveValues, Position, read_position, write_position
from drivecomm.server.mqtt.value_backfill import ValueBackfill

NOON = 1_795_000_000.0


def value(number):
    reading = Reading(parameter="1", value=Decimal(number), raw=number, unit="Hz", time_s=NOON + number)
    return CurrentValue(drive="pump", name="f", reading=reading, quality="good", time_s=NOON + number)


class Broker:
    """A broker that accepts a number of messages, then disconnects."""

    def __init__(self, takes=10_000):
        self.messages, self._takes = [], takes

    async def publish(self, message):
        await asyncio.sleep(0)
        if len(self.messages) >= self._takes:
            raise LinkDownError("gone")
        assert not message.retain
        self.messages.append(parsed(message.payload))

    @property
    def numbers(self):
        return [int(each["value"]) for message in self.messages for each in message["values"]]


class Plant:
    def __init__(self, folder):
        self.file, self.history = folder / "position.json", folder / "history.sqlite"
        self.store = HistoryFile(self.history)
        self.live, self.told = LiveValues(), []

    def add(self, first, last):
        self.store.add([value(number) for number in range(first, last)], [])

    async def run(self, broker, until, rules=None):
        new = None if rules is None else partial(ChangeDetector, rules)
        one = ValueBackfill(
            HistoryService(self.history), self.live, "historical", self.file, new_changes=new, tell=self.told.append
        )
        await one.begin()
        running = asyncio.create_task(one.run(broker))
        async with asyncio.timeout(10):
            while not (until(one) or running.done()):  # noqa: ASYNC110 - no single event to wait for
                await asyncio.sleep(0.01)
        await cancel_and_wait(running)
        await one.end()


@pytest.fixture
def plant(tmp_path, monkeypatch):
    monkeypatch.setattr(value_backfill, "LOOKED_EVERY_S", 0.02)
    monkeypatch.setattr(value_backfill, "VALUES_A_MESSAGE", 10)
    made = Plant(tmp_path)
    yield made
    made.store.close()


def test_first_run_publishes_only_new_rows(plant):
    plant.add(0, 50)
    broker = Broker()

    async def test():
        added = False

        def until(one):
            nonlocal added
            if not added:
                plant.add(50, 60)
                added = True
            return one.published == 10

        await plant.run(broker, until)

    asyncio.run(test())
    assert broker.numbers == list(range(50, 60))


def test_catching_up_resumes_at_the_last_position_and_skips_live_values(plant):
    plant.add(0, 100)
    write_position(plant.file, Position(30, round((NOON + 29) * 1000)))
    for number in (40, 41, 99):
        plant.live.add(sample_of(value(number)))
    broker = Broker()
    asyncio.run(plant.run(broker, lambda one: one.published == 67))
    assert broker.numbers == [number for number in range(30, 100) if number not in (40, 41, 99)]
    assert [message["historical"] for message in broker.messages] == [True] * len(broker.messages)
    rows = [(message["first_row"], message["last_row"]) for message in broker.messages]
    assert rows == sorted(rows)
    assert read_position(plant.file) == Position(100, round((NOON + 99) * 1000))


def test_catching_up_publishes_only_changes_if_the_door_does(plant):
    plant.add(0, 100)
    write_position(plant.file, Position(30, round((NOON + 29) * 1000)))
    # The next values are compared with those that were published live.
    for number in (40, 41):
        plant.live.add(sample_of(value(number)))
    broker, rules = Broker(takes=1), ChangeRules(deadbands={"f": 9.5})
    asyncio.run(plant.run(broker, lambda one: one.published >= 1, rules))
    again = Broker()
    asyncio.run(plant.run(again, lambda one: one._position.row == 100, rules))
    assert broker.numbers[0] == 30
    assert {*broker.numbers, *again.numbers} >= {50, 60, 70, 80, 90}
    assert not {*broker.numbers, *again.numbers} & {31, 39, 40, 41, 42, 49, 51}


def test_catching_up_loses_no_value_if_the_broker_disconnects(plant):
    plant.add(0, 200)
    write_position(plant.file, Position(1, round(NOON * 1000)))
    brokers = [Broker(takes) for takes in (3, 0, 7, 10_000)]
    for broker in brokers:
        asyncio.run(plant.run(broker, lambda one: one._position.row == 200))
    numbers = [number for broker in brokers for number in broker.numbers]
    assert set(numbers) == set(range(1, 200))
    assert all(broker.numbers == sorted(broker.numbers) for broker in brokers)
    # Only messages in flight at a disconnect are published twice.
    assert len(numbers) - len(set(numbers)) <= 3 * 4 * 10


def test_new_history_file_is_published_once_from_the_last_time(plant):
    """Row numbers may start again after a power cut, or after a damaged file was replaced."""
    plant.add(0, 60)
    write_position(plant.file, Position(500, round((NOON + 20) * 1000)))
    broker = Broker()
    asyncio.run(plant.run(broker, lambda one: one._position.row == 60))
    assert broker.numbers == list(range(21, 60))
    assert read_position(plant.file) == Position(60, round((NOON + 59) * 1000))


def test_unreadable_history_is_reported_once(plant):
    plant.add(0, 60)
    write_position(plant.file, Position(1, round(NOON * 1000)))
    plant.store.close()
    plant.history.write_bytes(b"x" * 5000)
    broker = Broker()
    seen = 0

    def until(_one):
        nonlocal seen
        seen += 1
        return seen > 20

    asyncio.run(plant.run(broker, until))
    assert broker.messages == []
    plant.history.unlink()
