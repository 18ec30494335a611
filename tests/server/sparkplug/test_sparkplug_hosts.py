"""The order in which commands of hosts are carried out, and the leases they use."""

import asyncio
from types import SimpleNamespace

import pytest
from served_core import awaited
from sparkplug_plant import command

from drivecomm.errors import NotAllowedError
from drivecomm.server import Caller, CommandAnswer, Role
from drivecomm.server.broker import ReceivedMessage
from drivecomm.server.sparkplug.hosts import MOST_STOPS, Hosts
from drivecomm.server.sparkplug.payload import DataType, Metric
from drivecomm.server.sparkplug.topics import SparkplugTopics

HOST = Caller(name="host", role=Role.OPERATE, door="sparkplug")
TOPICS = SparkplugTopics(group="plant", node="gateway", host="scada")
NODE = SimpleNamespace(drive_of=lambda device: device, named=lambda _drive, metric: metric)


class Plant:
    """Plant that completes a command when the test allows it. outcome: of all commands except stops."""

    def __init__(self, outcome="done"):
        self.begun, self.leases, self.outcome = [], set(), outcome
        self.done = asyncio.Semaphore(0)

    async def command(self, _caller, command):
        self.begun.append((command.verb, command.arguments.get("how", "ramp")))
        await self.done.acquire()
        if command.verb == "stop" or self.outcome == "done":
            return CommandAnswer(id=command.id, outcome="done")
        return CommandAnswer(id=command.id, outcome="refused", error=NotAllowedError("no"))

    async def take_lease(self, _caller, drive, _seconds):
        self.leases.add(drive)
        return SimpleNamespace(key=f"key of {drive}")

    async def end_lease(self, _caller, drive, _key):
        self.leases.discard(drive)

    def refuse(self, *_):
        pass


def hosts_of(plant):
    """Return the command handler for hosts, and a growing list of verbs and outcomes."""
    told = []
    hosts = Hosts(plant, HOST, TOPICS, lambda command, answer, _: told.append((command.verb, answer.outcome)))
    hosts.admit()
    return hosts, told


def send(hosts, *values, **more):
    hosts.heard(
        ReceivedMessage(topic=TOPICS.device_commands.replace("+", "fan"), payload=command(*values, **more)), NODE
    )


async def until(condition):
    async with asyncio.timeout(5):
        while not condition():  # noqa: ASYNC110 - any condition
            await asyncio.sleep(0)


@awaited
async def test_last_stop_of_a_flood_is_sent_after_all_others():
    plant = Plant()
    hosts, told = hosts_of(plant)
    for number in range(50):
        send(hosts, "Command/Stop", value=True, uuid=str(number))
    send(hosts, "Command/Stop Coast", value=True)
    await until(lambda: len(plant.begun) == MOST_STOPS)
    for _ in range(MOST_STOPS + 1):
        plant.done.release()
    await until(lambda: len(told) == MOST_STOPS + 1)
    assert plant.begun == [("stop", "ramp")] * MOST_STOPS + [("stop", "coast")]


@pytest.mark.parametrize(("outcome", "kept"), [("refused", set()), ("done", {"fan"})])
@awaited
async def test_lease_of_a_refused_start_is_released(outcome, kept):
    plant = Plant(outcome)
    hosts, told = hosts_of(plant)
    session = Metric(name="Command/Session", type=DataType.STRING, value="s")
    send(hosts, "Command/Start", value=True, more=(session,))
    await until(lambda: plant.begun)
    assert plant.leases == {"fan"}
    plant.done.release()
    await until(lambda: told)
    assert told == [("start", outcome)]
    assert plant.leases == kept
    hosts.forget()
