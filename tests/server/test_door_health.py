"""Health of each door, as `/metrics` of a real server reports it."""

import asyncio
import socket
import time
import urllib.request
from contextlib import ExitStack, closing

import pytest
from mosquitto import mosquitto, needs_mosquitto
from running_server import running_server
from served_core import simulated

from drivecomm.plant import read_plant
from drivecomm.server import DoorHealth, serving
from drivecomm.server.mqtt import value_backfill
from drivecomm.server.supervision import OpenDoor

PLANT = """\
format = 1
[server]
name = "hall"
status_period_s = 0.1
[[door]]
kind = "http"
listen = "127.0.0.1:0"
{doors}
[[line]]
name = "yard"
listen = "{listen}"
paced = false
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = {{ model = "fc302" }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.05 }}]
"""


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setattr(serving, "_OPEN_S", 2.0)


@pytest.fixture
def served(tmp_path):
    """Return a function that serves a plant of one virtual drive with these doors and an HTTP door.

    That function returns another one, which reads the samples of doors from `/metrics`.
    """
    file = tmp_path / "hall.toml"

    def serve(doors):
        file.write_text(PLANT.format(doors=doors, listen="tcp:127.0.0.1:0"))
        server, _ = stack.enter_context(simulated(read_plant(file)))
        file.write_text(PLANT.format(doors=doors, listen=f"tcp:{server.addresses['yard'].partition('://')[2]}"))
        plant = stack.enter_context(running_server(file))
        name = next(each.name for each in plant.doors() if each.name.startswith("http "))
        return lambda: door_samples(name.removeprefix("http "))

    with ExitStack() as stack:
        yield serve


def soon(condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.05)


def door_samples(address):
    """Scrape the server, and return the samples of doors by name and door."""
    with urllib.request.urlopen(f"http://{address}/metrics", timeout=10) as answer:
        lines = [line for line in answer.read().decode().splitlines() if line.startswith("drivecomm_door_")]
    samples = [line.rpartition(" ") for line in lines]
    found = {name.removeprefix("drivecomm_door_"): float(number) for name, _, number in samples}
    assert len(found) == len(samples), "a sample is repeated"
    return found


def of(scrape, what, kind):
    """Return the sample of the only door of a kind."""
    (found,) = (number for name, number in scrape().items() if name.startswith(f'{what}{{door="{kind} '))
    return found


@needs_mosquitto
@pytest.mark.soak
@pytest.mark.parametrize("kind", ["mqtt", "sparkplug"])
def test_backlog_grows_while_the_broker_is_away_and_shrinks_afterwards(tmp_path, served, monkeypatch, kind):
    monkeypatch.setattr(value_backfill, "LOOKED_EVERY_S", 0.1)
    # Values older than two keep-alives count as received by Sparkplug hosts, newer ones do not.
    many, few = {"mqtt": (90, 60), "sparkplug": (250, 200)}[kind]
    keys = 'group = "works"\nnode = "hall"' if kind == "sparkplug" else ""
    with mosquitto(tmp_path / "broker") as broker:
        scrape = served(f'[[door]]\nkind = "{kind}"\nbroker = "{broker.url}"\nkeep_alive_s = 2\n{keys}')
        soon(lambda: of(scrape, "up", kind) == 1)
        with broker.away():
            soon(lambda: of(scrape, "up", kind) == 0)
            soon(lambda: of(scrape, "backlog_rows", kind) > many, 30)
        soon(lambda: of(scrape, "up", kind) == 1)
        soon(lambda: of(scrape, "backlog_rows", kind) < few, 30)
    assert not any(name.startswith(f'clients{{door="{kind} ') for name in scrape())


@pytest.mark.soak
def test_clients_are_counted_while_they_are_connected(served):
    modbus = '[[door]]\nkind = "modbus-tcp"\nlisten = "127.0.0.1:0"\nunits = { fan = 1 }\n'
    scrape = served(modbus + '[[door]]\nkind = "opcua"\nlisten = "127.0.0.1:0"\nanonymous = "view"\n')
    # The scrape itself is a client, and the connection of the scrape before may still be closing.
    soon(lambda: [of(scrape, "clients", kind) for kind in ("http", "modbus-tcp", "opcua")] == [1, 0, 0])
    with ExitStack() as connections:
        for name in scrape():
            kind, _, address = name.partition('"')[2].rstrip('"}').partition(" ")
            if name.startswith("clients") and kind != "local":
                host, port = address.split(":")
                for _ in range(2):
                    connections.enter_context(closing(socket.create_connection((host, int(port)))))
        soon(lambda: [of(scrape, "clients", kind) for kind in ("http", "modbus-tcp", "opcua")] == [3, 2, 2])
    soon(lambda: [of(scrape, "clients", kind) for kind in ("http", "modbus-tcp", "opcua")] == [1, 0, 0])


@pytest.mark.soak
def test_door_that_cannot_listen_is_down_until_it_can(served):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        scrape = served(f'[[door]]\nkind = "modbus-tcp"\nlisten = "127.0.0.1:{port}"\nunits = {{ fan = 1 }}')
        assert of(scrape, "up", "modbus-tcp") == 0
        assert of(scrape, "up", "http") == 1
    soon(lambda: of(scrape, "up", "modbus-tcp") == 1, 20)


@pytest.mark.soak
def test_doors_on_one_broker_have_separate_samples(served):
    door = '[[door]]\nkind = "mqtt"\nbroker = "mqtt://127.0.0.1:9"\nprefix = "{}"\n'
    found = served(door.format("one") + door.format("two"))()
    assert [found[f'up{{door="mqtt 127.0.0.1:9{number}"}}'] for number in ("", " (2)")] == [0, 0]


class OwnDoor:
    """A door from another package, without a health report."""

    name = "own"

    async def run(self, _plant, opened):
        opened()
        await asyncio.Event().wait()


class Reporting(OwnDoor):
    """A door that reports its health."""

    def health(self):
        return DoorHealth(up=True, clients=2, delivered_row=7)


class Broken(OwnDoor):
    """A door whose health report raises an exception."""

    def health(self):
        raise RuntimeError("a mistake")


@pytest.mark.parametrize(
    ("door", "expected"),
    [(OwnDoor(), (True, None, None)), (Reporting(), (True, 2, 3)), (Broken(), (False, None, None))],
)
def test_state_of_a_door_from_another_package_is_its_own_report(door, expected):
    with closing(OpenDoor(door, None, lambda _: None)) as watched:
        assert watched.opened.wait(5)
        state = watched.state(10)
        assert (state.up, state.clients, state.backlog_rows) == expected
        assert watched.state(None).backlog_rows is None
    assert door.name == state.name
