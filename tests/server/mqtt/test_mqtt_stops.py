"""Stops in a flood of messages: every requested stop is sent, and no other message is let through."""

import asyncio
import json
from types import SimpleNamespace

import pytest
from served_core import awaited

from drivecomm.errors import NotAllowedError, UsageError
from drivecomm.server import Caller, CommandAnswer, Role
from drivecomm.server.broker import ReceivedMessage
from drivecomm.server.mqtt import commanding, stops
from drivecomm.server.mqtt.callers import BrokerCallers
from drivecomm.server.mqtt.commanding import Commanding
from drivecomm.server.mqtt.topics import Topics

TOPICS = Topics("drivecomm/hall")


class Plant:
    """Plant of a number of drives, named d0, d1 and so on, which records its commands."""

    def __init__(self, drives):
        self.plant = SimpleNamespace(drives=[f"d{number}" for number in range(drives)])
        self.stops, self.all, self.told, self.renewed, self.refused = [], [], [], 0, []
        self.waits = asyncio.Event()

    def drive(self, name):
        if name not in self.plant.drives:
            raise UsageError(f"there is no drive {name!r}")

    async def command(self, _caller, command):
        if command.verb == "wait":
            self.waits.set()
            await asyncio.Event().wait()
        self.stops.append((command.drive, command.arguments.get("how", "")))
        return CommandAnswer(id=command.id, outcome="done")

    async def stop_all(self, _caller, how, lines=()):
        self.all.append((how, *lines))
        return []

    async def renew_lease(self, caller, drive, key, _seconds):
        self.renewed += 1
        return SimpleNamespace(drive=drive, holder=caller, until_s=0.0, key=key)

    def refuse(self, _caller, _command, why):
        self.refused.append(why)

    def tell(self, text, **_):
        self.told.append(text)


class Connection:
    """Connection that records its subscriptions."""

    def __init__(self):
        self.listens = set()

    async def subscribe(self, *topics):
        self.listens.update(topics)

    async def unsubscribe(self, *topics):
        self.listens.difference_update(topics)

    async def answer(self, *_):
        pass


class Users:
    """User otto, and no other."""

    def caller(self, token, door):
        if token != "otto's":
            raise NotAllowedError("this token is not known")
        return Caller(name="otto", role=Role.OPERATE, door=door)


async def command_handler(drives, *, users=None):
    """Return the command handler of a plant with this number of drives, the plant, and its connection."""
    plant, connection = Plant(drives), Connection()
    callers = BrokerCallers(users=users, door="mqtt", role=None if users else Role.OPERATE)
    heard = Commanding(plant, TOPICS, callers, keeps_old=False)
    await heard.begin(connection)
    return heard, plant, connection


def stop(drive, payload=b""):
    return ReceivedMessage(topic=TOPICS.stop(drive), payload=payload)


async def until_all_sent(heard):
    """Wait until every received stop is sent."""
    while heard._stops.wait or heard._stopping:  # noqa: ASYNC110 - waits for internal tasks
        await asyncio.sleep(0)


@awaited
async def test_stops_of_many_drives_are_sent_immediately():
    heard, plant, connection = await command_handler(300)
    for drive in plant.plant.drives:
        heard.received(stop(drive))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert [drive for drive, _ in plant.stops] == plant.plant.drives
    assert f"{TOPICS.prefix}/+/stop" in connection.listens


@awaited
async def test_latest_stop_of_each_drive_is_sent_in_a_flood():
    heard, plant, connection = await command_handler(3)
    guard = asyncio.create_task(heard.guard(connection))
    for _ in range(500):
        heard.received(stop("d0", b"coast"))
    heard.received(stop("d1"))
    heard.received(stop("d0", b"quick"))
    await until_all_sent(heard)
    assert plant.stops[-2:] == [("d0", "quick"), ("d1", "")]
    assert len(plant.stops) < 150
    assert f"{TOPICS.prefix}/+/stop" in connection.listens
    assert plant.told == []
    # After the flood stops are as fast as before.
    before = len(plant.stops)
    await asyncio.sleep(0.05)
    heard.received(stop("d2"))
    await asyncio.sleep(0.01)
    assert plant.stops[before:] == [("d2", "")]
    guard.cancel()


@awaited
async def test_flood_without_a_token_does_not_block_stops_of_users():
    heard, plant, _ = await command_handler(3, users=Users())
    wanted = json.dumps({"token": "otto's"}).encode()
    for _ in range(300):
        heard.received(stop("d0", b"{}"))
    heard.received(stop("d0", wanted))
    for number in range(300):
        heard.received(stop("d0", b"{"))
        heard.received(stop(f"unknown{number}", wanted))
    await until_all_sent(heard)
    assert plant.stops == [("d0", "")]
    assert len(plant.told) == 1
    assert "are not stops" in plant.told[0]
    assert len(plant.refused) < 200


@awaited
async def test_stop_of_all_drives_works_while_requests_are_paused(monkeypatch):
    monkeypatch.setattr(commanding, "PAUSE_S", 0.1)
    heard, plant, connection = await command_handler(2)
    guard = asyncio.create_task(heard.guard(connection))
    everything = f"{TOPICS.bridge}/request/stop"
    for _ in range(300):
        heard.received(ReceivedMessage(topic=f"{TOPICS.bridge}/request/explode", payload=b"{}"))
    await asyncio.sleep(0.02)
    assert f"{TOPICS.bridge}/request/#" not in connection.listens
    assert everything in connection.listens
    for lines in ([], ["hall"], ["yard"]):
        heard.received(ReceivedMessage(topic=everything, payload=json.dumps({"lines": lines}).encode()))
    await asyncio.sleep(0.02)
    assert plant.all == [("ramp",), ("ramp", "hall"), ("ramp", "yard")]
    await asyncio.sleep(0.15)
    assert f"{TOPICS.bridge}/request/#" in connection.listens
    assert everything not in connection.listens
    guard.cancel()


@awaited
async def test_lease_renewals_of_many_drives_are_not_limited():
    heard, plant, _ = await command_handler(200)
    for _ in range(2):
        for drive in plant.plant.drives:
            content = {"id": drive, "session": heard.session, "drive": drive, "key": "k", "seconds": 3}
            heard.received(
                ReceivedMessage(topic=f"{TOPICS.bridge}/request/lease/renew", payload=json.dumps(content).encode())
            )
    await asyncio.sleep(0.1)
    assert plant.renewed == 400


@awaited
async def test_stop_received_before_a_lost_connection_is_sent():
    heard, plant, _ = await command_handler(1)
    heard.received(stop("d0"))
    heard.end()
    await asyncio.sleep(0.01)
    assert plant.stops == [("d0", "")]


@awaited
async def test_waiting_command_is_cancelled_with_the_connection():
    heard, plant, _ = await command_handler(1)
    content = {"id": "1", "verb": "wait", "session": heard.session, "arguments": {"goal": "ready"}}
    heard.received(ReceivedMessage(topic=TOPICS.command("d0"), payload=json.dumps(content).encode()))
    await plant.waits.wait()
    (waiting,) = heard._doing
    heard.end()
    async with asyncio.timeout(5):
        await asyncio.wait([waiting])
    assert waiting.cancelled()


@pytest.mark.parametrize("room", [1, 2])
@awaited
async def test_number_of_waiting_stops_is_limited(monkeypatch, room):
    monkeypatch.setattr(stops, "MOST", room)
    handed_on = []
    waiting = stops.Stops(handed_on.append)
    fit = [waiting.put(of, stop(of)) for of in ("d0", "d1", "d0")]
    assert fit == [True, room == 2, True]
    await asyncio.sleep(0.1)
    assert [each.topic for each in handed_on] == [TOPICS.stop(f"d{number}") for number in range(room)]
