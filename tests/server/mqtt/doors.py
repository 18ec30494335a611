"""An MQTT door of a real core over virtual drives, on a real broker, and a client on that broker."""

import asyncio
import json
import time
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import count

from mosquitto import until
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from drivecomm.client import parsed
from drivecomm.errors import NotAllowedError
from drivecomm.server import Caller, Role, cancel_and_wait
from drivecomm.server.broker import BROKER_KEYS, BrokerMessage, broker_settings
from drivecomm.server.broker.connection import connect_to_broker
from drivecomm.server.mqtt import mqtt_door
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.tomlfile import TomlTable

TOKENS = {
    "anna's": Caller(name="anna", role=Role.VIEW, door="mqtt"),
    "otto's": Caller(name="otto", role=Role.OPERATE, door="mqtt"),
    "olga's": Caller(name="olga", role=Role.OPERATE, door="mqtt"),
}


class Users:
    """Users anna (view), otto and olga (both operate)."""

    def caller(self, token, door):
        if token not in TOKENS:
            raise NotAllowedError("this token is not known")
        return replace(TOKENS[token], door=door)


class Client:
    """Client of the broker that receives everything below the prefix, and sends commands."""

    def __init__(self, prefix, settings):
        self.prefix, self.settings, self.heard, self.ids = prefix, settings, [], count(1)
        self.connection = None

    def hear(self, received):
        self.heard.append(received)

    def payloads(self, topic):
        return [parsed(each.payload) for each in self.heard if each.topic == f"{self.prefix}/{topic}" and each.payload]

    def latest(self, topic):
        found = self.payloads(topic)
        return found[-1] if found else None

    @property
    def session(self):
        return (self.latest("bridge/state") or {}).get("session")

    async def publish(self, topic, content, *, retain=False):
        payload = content if isinstance(content, str | bytes) else json.dumps(content)
        await self.connection.publish(BrokerMessage(topic=f"{self.prefix}/{topic}", payload=payload, retain=retain))

    def command(self, verb, /, **more):
        """Return a valid command. more: fields that replace the valid ones; None omits a field."""
        content = {"id": f"c{next(self.ids)}", "verb": verb, "issued_s": time.time(), "valid_s": 5,
                   "session": self.session, **more}  # fmt: skip
        return {key: value for key, value in content.items() if value is not None}

    async def ask(self, drive, content, *, retain=False, topic="command"):
        """Publish a command, and return the response with the same id."""
        one = content.get("id", "") if isinstance(content, dict) else ""

        def answers():
            return [each for each in self.payloads(f"{drive}/response") if each["id"] == one]

        before = len(answers())
        await self.publish(f"{drive}/{topic}", content, retain=retain)
        await until(lambda: len(answers()) > before)
        return answers()[before]

    async def publish_for_answer(self, topic, content, answer_to):
        """Publish a command whose response goes to a topic of the client's choice, as in MQTT 5."""
        properties = Properties(PacketTypes.PUBLISH)
        properties.ResponseTopic = answer_to
        properties.CorrelationData = b"mine"
        topic = f"{self.prefix}/{topic}"
        await self.connection._client.publish(topic, json.dumps(content), qos=1, properties=properties)

    async def cut(self):
        """Cut the gateway's connection to the broker, and wait until it is connected again."""
        before = self.session
        async with connect_to_broker(self.settings, self.prefix.replace("/", "-"), print):
            pass
        await until(lambda: self.session not in (None, before))

    async def request(self, what, **content):
        before = len(self.payloads(f"bridge/response/{what}"))
        given = {"id": f"r{next(self.ids)}", "session": self.session, **content}
        await self.publish(f"bridge/request/{what}", given)
        await until(lambda: len(self.payloads(f"bridge/response/{what}")) > before)
        return self.payloads(f"bridge/response/{what}")[before]


@asynccontextmanager
async def listening(broker, prefix="drivecomm/hall"):
    """Yield a client that receives everything below the prefix."""
    table = TomlTable({"broker": broker.url}, "x.toml")
    client = Client(prefix, broker_settings(table, table.take(BROKER_KEYS)))
    async with connect_to_broker(client.settings, "client", client.hear) as connection:
        client.connection = connection
        await connection.subscribe_with_kept("#")
        yield client


@asynccontextmanager
async def open_door(core, broker, *, users=None, history=None, name="hall", place=None, **table):
    """Run the door in this loop until the end of the block; yield it."""
    plant = PlantForDoors(core, name, users=users, history=history)
    door = mqtt_door(TomlTable({"broker": place or broker.url, **table}, "hall.toml"))
    opened = asyncio.Event()
    running = asyncio.create_task(door.run(plant, opened.set))
    try:
        opening = asyncio.create_task(opened.wait())
        await asyncio.wait({running, opening}, return_when=asyncio.FIRST_COMPLETED, timeout=20)
        if running.done():
            running.result()
        yield door
    finally:
        await cancel_and_wait(running)


def door_events(core):
    return [each.text for each in core.table.events() if each.kind == "door"]
